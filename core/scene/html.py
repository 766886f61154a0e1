"""HTML for notebooks: tables, and text in columns."""

from collections.abc import Sequence
from html import escape


def html_table(rows: Sequence[Sequence[str]], caption: str = "") -> str:
    """HTML table; the first row is the header."""
    head, *body = rows
    parts = [f"<caption>{escape(caption)}</caption>"] if caption else []
    parts.append("<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>")
    parts += ["<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
              for row in body]
    return f"<table>{''.join(parts)}</table>"


def html_text(text: str) -> str:
    """HTML of text whose columns are aligned by spaces."""
    return f"<pre>{escape(text)}</pre>"
