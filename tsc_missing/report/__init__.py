"""Reports: tables and figures of batches, as Markdown and as one HTML file."""
