"""The page of a study: answer, tables, pictures and their meaning."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from startrack.metrics import Table
from startrack.report.page import Section, code, embedded, page, paragraph, records


def write_study_page(
    title: str,
    answer: str,
    tables: Sequence[Table],
    meanings: Sequence[str],
    pictures: Mapping[str, Path],
    more: Mapping[str, str],
) -> str:
    """The page as HTML.

    answer    a sentence at the top of the page
    meanings  paragraphs on the meaning of the tables and on the computation
    pictures  files by caption
    more      preformatted texts by title
    """
    shown = "".join(records("By forecast", table) for table in tables)
    sections = [Section("Table", shown)]
    if pictures:
        drawn = "".join(embedded(caption, file) for caption, file in pictures.items())
        sections.append(Section("Pictures", drawn))
    texts = [*map(paragraph, meanings), *(code(name, text) for name, text in more.items())]
    sections.append(Section("How it was computed", "".join(texts)))
    return page(title, answer, sections)
