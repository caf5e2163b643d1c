"""A report as one HTML file that needs no other."""

import base64
import html
from collections.abc import Mapping

from tsc_missing.report.document import FIGURES, Report

STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; color: #1f2933; max-width: 64rem; margin: 2rem auto;
  padding: 0 1rem; }
h1, h2, h3 { line-height: 1.25; }
table { border-collapse: collapse; margin: 1rem 0; font-size: 0.85rem;
  font-variant-numeric: tabular-nums; }
th, td { padding: 0.25rem 0.6rem; border-bottom: 1px solid #d3d8dd; text-align: left; }
th { border-bottom: 2px solid #52606d; }
img { max-width: 100%; height: auto; }
code { font-size: 0.85em; background: #f0f2f4; padding: 0.1em 0.25em; }
.wide { overflow-x: auto; }
@media print { body { max-width: none; margin: 0; font-size: 10pt; } table { font-size: 7.5pt; }
  h2, h3 { break-after: avoid; } img, tr { break-inside: avoid; } .wide { overflow: visible; } }
"""


def to_html(report: Report, images: Mapping[str, bytes]) -> str:
    """The report as one HTML file that needs no other; ``images`` are SVGs by picture."""
    from markdown_it import MarkdownIt

    body = str(MarkdownIt("commonmark", {"html": True}).enable("table").render(report.markdown))
    for name, image in images.items():
        data = base64.b64encode(image).decode("ascii")
        body = body.replace(
            f'src="{FIGURES}/{name}.png"', f'src="data:image/svg+xml;base64,{data}"'
        )
    body = body.replace("<table>", '<div class="wide"><table>').replace(
        "</table>", "</table></div>"
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(report.title)}</title>\n<style>{STYLE}</style>\n</head>\n"
        f"<body>\n{body}</body>\n</html>\n"
    )
