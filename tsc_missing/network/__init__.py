"""Networks: from road descriptions to one array view of intersections."""
