"""Pieces of Markdown."""

from collections.abc import Sequence

from tsc_missing.report.statistics import Mean, Ratio

NOTHING = "–"


def escaped(text: str) -> str:
    """Text that Markdown and HTML show as it is, in a table's cell too."""
    for character in "\\`*_[]|":
        text = text.replace(character, f"\\{character}")
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def table(header: Sequence[str], rows: Sequence[Sequence[str]], words: int = 1) -> list[str]:
    """A table; all but the first ``words`` columns are flush right."""
    marks = [*["---"] * words, *["---:"] * (len(header) - words)]
    return ["", *(f"| {' | '.join(line)} |" for line in (header, marks, *rows)), ""]


def mean_words(mean: Mean | None, digits: int = 1) -> str:
    """For example ``324.2 ± 1.1``."""
    if mean is None:
        return NOTHING
    error = f" ± {mean.error:.{digits}f}" if mean.error is not None else ""
    return f"{mean.value:.{digits}f}{error}"


def change_words(ratio: Ratio | None) -> str:
    """For example ``−3.2 % [−4.0, −2.1]``: by how much it is more than its partner.

    An interval of no width as printed is left out: it would look like certainty.
    """
    if ratio is None:
        return NOTHING
    words = f"{signed(100 * (ratio.value - 1))} %"
    if ratio.interval is not None:
        low, high = (signed(100 * (end - 1)) for end in ratio.interval)
        if low != high:
            words += f" [{low}, {high}]"
    return words


def signed(value: float) -> str:
    """With one digit and a sign that is as wide as a digit."""
    rounded = round(value, 1) + 0.0
    return f"{'−' if rounded < 0 else '+'}{abs(rounded):.1f}"


def marked(text: str, rank: int | None) -> str:
    """The best (rank 0) in bold, the second underlined."""
    return f"**{text}**" if rank == 0 else f"<ins>{text}</ins>" if rank == 1 else text
