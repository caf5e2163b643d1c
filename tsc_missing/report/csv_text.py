"""Tables for spreadsheets and other programs."""

import csv
import io
from collections.abc import Mapping, Sequence

DECIMALS = 4


def csv_text(rows: Sequence[Mapping[str, object]]) -> str:
    """At least one row, of the same keys, as CSV under a header.

    Numbers have 4 decimals at the most; None is empty.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows({key: _short(value) for key, value in row.items()} for row in rows)
    return text.getvalue()


def _short(value: object) -> object:
    return round(value, DECIMALS) if isinstance(value, float) else value
