"""A report in one HTML file: tables, pictures and provenance, nothing fetched from elsewhere."""

from __future__ import annotations

import base64
import dataclasses
import html
from collections.abc import Mapping, Sequence
from pathlib import Path

from track_localization.evaluation.tabulate import Table

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #222; max-width: 1080px; margin: 2em auto;
       padding: 0 1em; }
h1 { font-size: 1.6em; } h2 { font-size: 1.25em; margin-top: 2em; border-bottom: 1px solid #ccc; }
table { border-collapse: collapse; margin: 1em 0; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding-bottom: .4em; }
th, td { border-bottom: 1px solid #ddd; padding: .2em .7em; text-align: left; }
th { background: #f4f4f4; } td.number { text-align: right; }
figure { margin: 1.5em 0; } figure img { max-width: 100%; } figcaption { color: #555; }
pre { background: #f4f4f4; padding: .8em; overflow-x: auto; }
.wide { overflow-x: auto; }
"""


@dataclasses.dataclass(frozen=True)
class Picture:
    """A PNG file and what it shows."""

    path: Path
    caption: str


@dataclasses.dataclass(frozen=True)
class Section:
    """
    A heading with, in this order, sentences, named facts, tables, pictures and preformatted text.

    ``sentences`` become list items.
    """

    heading: str
    sentences: Sequence[str] = ()
    facts: Mapping[str, str] = dataclasses.field(default_factory=dict)
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    verbatim: str = ''


def write_report(path: Path, title: str, sections: Sequence[Section]) -> None:
    """Write the sections as one HTML file with the pictures inside it."""
    body = '\n'.join(_section(section) for section in sections)
    path.write_text(
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<title>{html.escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n'
        f'<h1>{html.escape(title)}</h1>\n{body}\n</body>\n</html>\n',
        encoding='utf-8',
    )


def _section(section: Section) -> str:
    parts = [f'<h2>{html.escape(section.heading)}</h2>']
    if section.sentences:
        items = ''.join(f'<li>{html.escape(s)}</li>' for s in section.sentences)
        parts.append(f'<ul>{items}</ul>')
    if section.facts:
        rows = [(name, value) for name, value in section.facts.items()]
        parts.append(Table('', ('', ''), rows).html())
    parts += [f'<div class="wide">{table.html()}</div>' for table in section.tables]
    parts += [_picture(picture) for picture in section.pictures]
    if section.verbatim:
        parts.append(f'<pre>{html.escape(section.verbatim)}</pre>')
    return '\n'.join(parts)


def _picture(picture: Picture) -> str:
    data = base64.b64encode(picture.path.read_bytes()).decode('ascii')
    caption = html.escape(picture.caption)
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
        f'<figcaption>{caption}</figcaption></figure>'
    )
