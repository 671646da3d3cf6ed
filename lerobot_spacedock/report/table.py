"""A table once, written as Markdown, LaTeX, HTML and JSON."""

from __future__ import annotations

import html
import re
from dataclasses import dataclass, field
from textwrap import wrap
from typing import Any

DASH = "–"
HEAD_CHARACTERS = 8  # a head in LaTeX is broken here, unless its column is wider anyway
TEXT_CHARACTERS = 28  # and a cell here


@dataclass(frozen=True)
class Cell:
    """A number with how it is shown; ``value`` goes to the JSON."""

    text: str
    value: Any = None


@dataclass(frozen=True)
class Table:
    """A titled grid.

    Attributes:
        key: file name and anchor, for example ``table3``.
        title: one line.
        head: column heads, units in them.
        rows: cells; plain strings are text.
        notes: sentences below the table.
        left: how many first columns are text, left-aligned.
        reference_rows: indices of rows that hold the paper's numbers, set apart in the page.
    """

    key: str
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[Cell | str, ...], ...]
    notes: tuple[str, ...] = ()
    left: int = 1
    reference_rows: frozenset[int] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.head):
                raise ValueError(f"{self.key}: row of {len(row)} cells under {len(self.head)} heads: {row}")


def number(value: float | None, digits: int = 3, suffix: str = "") -> Cell:
    """``value`` with ``digits`` decimals; scientific where that would hide it; a dash where there is none.

    What is below 1e-12 is rounding, and shown as zero.
    """
    if value is None:
        return Cell(DASH, None)
    shown = value if abs(value) > 1e-12 else 0.0
    text = f"{shown:,.{digits}f}"
    if 0.0 < abs(shown) < 10.0 ** (-digits):
        text = f"{shown:.1e}"
    return Cell(text.replace("-", "−") + suffix, float(value))


def integer(value: int | float | None) -> Cell:
    """A count with thousands separated; a dash where there is none."""
    return Cell(DASH, None) if value is None else Cell(f"{int(value):,}", int(value))


def p_value(p: float | None) -> Cell:
    """A p-value as papers print it; below 1e-300 it is given as a bound, not as zero."""
    if p is None:
        return Cell(DASH, None)
    if p < 1e-300:
        return Cell("< 1e−300", float(p))
    return Cell((f"{p:.3f}" if p >= 0.001 else f"{p:.1e}").replace("-", "−"), float(p))


def percent(successes: int, n: int) -> str:
    """A share in per cent, to a tenth where it is no whole number; never rounded to 100 or to 0."""
    text = f"{100.0 * successes / n:.1f}".removesuffix(".0")
    if 0 < successes < n:
        text = {"100": "> 99.9", "0": "< 0.1"}.get(text, text)
    return text


def share(successes: int, n: int, low: float | None, high: float | None) -> Cell:
    """``share % [low, high]``, the interval in per cent; 100 and 0 are said of all and of none alone."""
    if n == 0 or low is None or high is None:
        return Cell(f"{DASH} (0 episodes)", {"successes": successes, "n": n, "share": None})
    text = f"{percent(successes, n)} % [{100 * low:.1f}, {100 * high:.1f}]"
    return Cell(text, {"successes": successes, "n": n, "share": successes / n, "low": low, "high": high})


def interval(estimate: float | None, low: float | None, high: float | None, digits: int = 3) -> Cell:
    """``estimate [low, high]``; the brackets are left out where there is no interval."""
    if estimate is None:
        return Cell(DASH, {"estimate": None, "low": None, "high": None})
    text = number(estimate, digits).text
    if low is not None and high is not None:
        text += f" [{number(low, digits).text}, {number(high, digits).text}]"
    return Cell(text, {"estimate": estimate, "low": low, "high": high})


def text_of(cell: Cell | str) -> str:
    return cell.text if isinstance(cell, Cell) else cell


def to_markdown(table: Table) -> str:
    """GitHub-flavoured Markdown, with the notes below."""
    lines = [f"### {table.title}", ""]
    lines.append("| " + " | ".join(_md(head) for head in table.head) + " |")
    lines.append("|" + "|".join(":--" if i < table.left else "--:" for i in range(len(table.head))) + "|")
    lines += ["| " + " | ".join(_md(text_of(cell)) for cell in row) + " |" for row in table.rows]
    lines += ["", *(f"*{note}*\n" for note in table.notes)]
    return "\n".join(lines).rstrip() + "\n"


def to_latex(table: Table) -> str:
    """A ``booktabs`` table that compiles under pdfLaTeX and is no wider than the line; needs ``graphicx`` for that.

    Heads and long words are broken into lines; what is too wide even so is scaled down.
    """
    spec = "l" * table.left + "r" * (len(table.head) - table.left)
    texts = [[text_of(cell) for cell in row] for row in table.rows]
    heads = []
    for i, head in enumerate(table.head):
        widest = max((min(len(row[i]), TEXT_CHARACTERS) for row in texts), default=0)
        heads.append(_tex_lines(head, max(widest, HEAD_CHARACTERS), spec[i], "b"))
    body = "\n".join(
        "  " + " & ".join(_tex_lines(text, TEXT_CHARACTERS, spec[i], "t") for i, text in enumerate(row)) + r" \\"
        for row in texts
    )
    notes = "".join(f"\n  % {note}" for note in table.notes)
    title = re.sub(r"^Table \d+\. ", "", table.title)  # LaTeX counts by itself
    return (
        "\\begin{table}[t]\n  \\centering\\footnotesize\\setlength{\\tabcolsep}{4pt}\n"
        f"  \\caption{{{_tex(title)}}}\n  \\label{{tab:{table.key}}}\n"
        "  \\resizebox{\\ifdim\\width>\\linewidth\\linewidth\\else\\width\\fi}{!}{%\n"
        f"  \\begin{{tabular}}{{{spec}}}\n  \\toprule\n"
        f"  {' & '.join(heads)} \\\\\n  \\midrule\n{body}\n"
        f"  \\bottomrule\n  \\end{{tabular}}}}{notes}\n\\end{{table}}\n"
    )


def to_html(table: Table) -> str:
    """A ``figure`` that scrolls inside itself on a narrow screen."""
    head = "".join(_th(name, i < table.left) for i, name in enumerate(table.head))
    rows = []
    for index, row in enumerate(table.rows):
        kind = ' class="paper"' if index in table.reference_rows else ""
        cells = "".join(
            f"<td{' class=text' if i < table.left else ''}>{html.escape(text_of(cell))}</td>"
            for i, cell in enumerate(row)
        )
        rows.append(f"<tr{kind}>{cells}</tr>")
    notes = "".join(f"<p class=note>{html.escape(note)}</p>" for note in table.notes)
    return (
        f'<figure class=table id="{table.key}"><figcaption>{html.escape(table.title)}</figcaption>'
        f'<div class=scroll tabindex=0 role=region aria-label="{html.escape(table.title, quote=True)}">'
        f"<table><thead><tr>{head}</tr></thead>"
        f"<tbody>{''.join(rows)}</tbody></table></div>{notes}</figure>"
    )


def to_json(table: Table) -> dict[str, Any]:
    """Heads, and a row as a mapping from head to value (numbers unrounded)."""
    rows = [
        {head: (cell.value if isinstance(cell, Cell) else cell) for head, cell in zip(table.head, row, strict=True)}
        for row in table.rows
    ]
    return {"title": table.title, "head": list(table.head), "rows": rows, "notes": list(table.notes)}


def _th(name: str, left: bool) -> str:
    return f"<th scope=col{' class=text' if left else ''}>{html.escape(name)}</th>"


def _md(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


_TEX = {
    "‖r_K‖": r"$\|r_K\|$", "‖v_K‖": r"$\|v_K\|$",
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_", "{": r"\{", "}": r"\}",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "‖": r"$\|$", "−": r"$-$", "–": "--", "±": r"$\pm$",
    "Δ": r"$\Delta$", "°": r"$^\circ$", "·": r"$\cdot$", "≤": r"$\leq$", "≥": r"$\geq$", "<": r"$<$", ">": r"$>$",
    "δ": r"$\delta$", "≈": r"$\approx$", "×": r"$\times$", "∈": r"$\in$", "²": r"$^2$", "→": r"$\to$", "α": r"$\alpha$",
    "†": r"$\dagger$", "’": "'", "“": "``", "”": "''", "…": r"\ldots{}",
}  # fmt: skip
_TEX_PATTERN = re.compile("|".join(re.escape(key) for key in _TEX))


def _tex_lines(text: str, width: int, align: str, anchor: str) -> str:
    lines = [_tex(line) for line in wrap(text, width, break_long_words=False, break_on_hyphens=False)]
    if len(lines) < 2:
        return "".join(lines)
    return f"\\begin{{tabular}}[{anchor}]{{@{{}}{align}@{{}}}}" + r" \\ ".join(lines) + "\\end{tabular}"


def _tex(text: str) -> str:
    return _TEX_PATTERN.sub(lambda match: _TEX[match.group()], text)
