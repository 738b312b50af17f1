"""The LaTeX forms compile as part of a plain article, and nothing in them runs off the page."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from made_runs import made_run, table_of

from fvi_cli.config import parse_config
from fvi_cli.integrator.method import Method
from fvi_cli.reports import Column, Report, Sheet, rendered
from fvi_cli.reports.document import Bullets, CodeSpan, Equation, Grid, Heading, Paragraph
from fvi_cli.reports.kinds.orders import order_report
from fvi_cli.reports.kinds.stability import stability_report
from fvi_cli.reports.table import alike
from fvi_cli.reports.writers.equations import to_mathematics
from fvi_cli.reports.writers.latex import PACKAGES, escape_latex, to_latex
from fvi_cli.reports.writers.text import escape_markdown, to_markdown
from fvi_cli.scenes.registry import KINDS
from fvi_cli.studies.order import OrderCase, OrderRow, OrderTable
from fvi_cli.studies.stability_study import StabilityTable, stability_rows

LETTERS = "a_b*c|d`e<f>&g#h$i%j^k~l{m}n\\o[p]\nq"
HOSTILE = "a_b*c|d`e<f>&g#h$i%j^k~l{m}n\\o[p] ü γ \x00 2^k^j x_1_(2)_3 x^2' 1e3^2 sqrt(t"
EQUATIONS = {name: kind.equation for name, kind in KINDS.items()}


@pytest.mark.parametrize(
    ("text", "typeset"),
    [
        ("M x'' + sum mu D^gamma x + K x = f(t)", r"M\,x'' + \sum\mu\,D^{\gamma}\,x + K\,x = f(t)"),
        ("mass x_i'' - x_(i-1)", r"\mathrm{mass}\,x_{i}'' - x_{i-1}"),
        ("wave_speed^2 u_ss", r"\mathrm{wave\_speed}^{2}\,u_{ss}"),
        ("theta2 - theta1", r"\theta_{2} - \theta_{1}"),
        ("x = t**2.5*sqrt(2e-3)", r"x = t^{2.5}\,\sqrt{2\cdot10^{-3}}"),
        ("t^a^b", "t^{a}{}^{b}"),
        ("x^", "x^{}"),
    ],
)
def test_equations_are_mathematics(text, typeset):
    assert to_mathematics(text) == [(typeset, True)]


def test_words_between_formulas_stay_words():
    found = to_mathematics(EQUATIONS["double-pendulum"])
    assert found[0] == ("two rods, angles", False)
    assert (r"c\,D^{\gamma}", True) in found
    assert to_mathematics("y = D^gamma f (Caputo)")[-1] == ("(Caputo)", False)


def order_tables(equation: str) -> list[OrderTable]:
    cases = []
    for degree in (1, 2, 3):
        for p in range(1, 7):
            rows = tuple(
                OrderRow(
                    n_steps=2**k,
                    step_size=2.0**-k,
                    error=2.0 ** (-p * k),
                    floor=1e-13,
                    status="ok",
                    predicted="unknown",
                    expected_order=float(p),
                    message=HOSTILE if k == 2 else "",
                )
                for k in range(1, 9)
            )
            method = Method(cq=f"bdf{p}", degree=degree, sampling="nodes")
            cases.append(OrderCase(method=method, rows=rows))
    common = {"gamma": "0.5;1.5", "reference": "expression", "norm": "max", "final_time": 1.0}
    return [
        OrderTable(experiment=name, equation=equation, cases=tuple(cases), **common)
        for name in ("one-with-a-long-name", "two")
    ]


STABILITY = """\
name: quick
problem: {kind: bagley-torvik, damping: [{order: 1.5, coefficient: 1.0}], final_time: 1.0}
method: [{rk: gauss, degree: 2}, {bdf: 6, sampling: nodes}]
ladder: {steps: [4, 8]}
"""


def stability() -> Report:
    (experiment,) = parse_config(STABILITY, "quick.yaml").experiments
    rows = tuple(stability_rows(experiment, with_observation=False))
    return stability_report("quick", [StabilityTable(experiment=experiment, rows=rows)])


def every_report() -> list[Report]:
    return [
        order_report("hostile", order_tables(HOSTILE)),
        *(order_report(kind, order_tables(text)[:1]) for kind, text in EQUATIONS.items()),
        stability(),
    ]


# --- letter by letter ----------------------------------------------------------------------------


def markdown_tables(text: str) -> list[list[list[str]]]:
    """Cells of every table, the line below the header left out."""
    found: list[list[list[str]]] = []
    before = ""
    for line in text.split("\n"):
        if line.startswith("|"):
            if not before.startswith("|"):
                found.append([])
            found[-1].append([cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]])
        before = line
    for one in found:
        rule = one.pop(1)
        assert all(re.fullmatch("-+:?", cell) for cell in rule)
        assert len(rule) == len(one[0])
    return found


def test_hostile_words_are_letters_in_markdown():
    escaped = escape_markdown(LETTERS)
    assert re.sub(r"\\(.)", r"\1", escaped) == LETTERS.replace("\n", " ")
    grid = Grid(header=("a", "b"), rows=((LETTERS, "1"),))
    text = to_markdown([grid, Paragraph(words=(CodeSpan("a`b``c"), LETTERS))])
    (cells,) = markdown_tables(text)
    assert len(cells[1]) == 2
    assert "``` a`b``c ```" in text


def unescaped(text: str) -> str:
    """LaTeX without what stands for one letter."""
    text = re.sub(r"\\text(backslash|asciicircum|asciitilde)\{\}", "", text)
    return re.sub(r"\\[{}$&#%_]|\{\\char96\}", "", text)


def test_hostile_words_are_letters_in_latex():
    escaped = escape_latex(LETTERS)
    assert escaped == (
        r"a\_b*c$|$d{\char96}e$<$f$>$\&g\#h\$i\%j\textasciicircum{}k\textasciitilde{}l\{m\}n"
        r"\textbackslash{}o[p] q"
    )
    assert escape_latex("ü and γ") == "ü and U+03B3"


def test_a_bracket_is_no_argument_of_the_end_of_a_row():
    text = to_latex([Grid(header=("[a]", "b"), rows=(("[1pt]", "2"),), text_columns=2)])
    assert "\n{}[a] & b" in text
    assert "\n{}[1pt] & 2" in text


def check_latex(text: str) -> int:
    """Balanced braces, dollars and environments, every row of every table as long as declared."""
    bare = unescaped(text)
    depth = 0
    for letter in bare:
        depth += {"{": 1, "}": -1}.get(letter, 0)
        assert depth >= 0
    assert depth == 0
    open_environments: list[str] = []
    for verb, name in re.findall(r"\\(begin|end)\{([a-z]+)\}", bare):
        if verb == "begin":
            open_environments.append(name)
        else:
            assert open_environments.pop() == name
    assert open_environments == []
    for line in bare.splitlines():
        assert line.count("$") % 2 == 0, line
    tables = re.findall(r"\\begin\{(?:tabular|longtable)\}(.*?)\\end\{", bare, re.DOTALL)
    for one in tables:
        head, *lines = one.strip().splitlines()
        columns = re.fullmatch(r"(?:\[l\])?\{@\{\}((?:[lr]|>\{.*?\}p\{\d+em\})*)@\{\}\}", head)[1]
        count = len(re.findall(r"[lr]|>\{.*?\}p\{\d+em\}", columns))
        for line in lines:
            if not re.match(r"\\(\w+rule|end\w+)", line):
                assert line.endswith(r" \\")
                assert line.count("&") == count - 1, line
    assert set(re.findall(r"\\([a-zA-Z]+)", bare)) <= KNOWN_COMMANDS
    return len(tables)


KNOWN_COMMANDS = {
    *("input", "usepackage", "setlength", "parindent", "tabcolsep", "raggedright", "begin", "end"),
    *("section", "subsection", "footnotesize", "item", "texttt", "par", "smallskip", "medskip"),
    *("toprule", "midrule", "bottomrule", "endhead", "endfoot", "endlastfoot", "multicolumn"),
    *(
        "arraybackslash",
        "allowbreak",
        "textsuperscript",
        "cdot",
        "sum",
        "sqrt",
        "mu",
        "gamma",
        "sin",
        "backslash",
        "sim",
    ),
}


def test_latex_is_balanced_and_its_tables_have_the_columns_they_declare():
    reports = [order_report("hostile", order_tables(HOSTILE)), stability()]
    files = [file for report in reports for file in rendered(report).items()]
    assert sum(check_latex(text) for name, text in files if name.endswith("tex")) >= 2 * 2
    # controls: a brace too many, a column too few
    with pytest.raises(AssertionError):
        check_latex(to_latex([Paragraph(words="a")]).replace("a\\par", "{a\\par"))
    tabular = to_latex([Grid(header=("a", "b"), rows=(("1", "2"),), text_columns=0)])
    assert "{rr}" in tabular.replace("@{}", "")
    with pytest.raises(AssertionError):
        check_latex(tabular.replace("rr", "r"))


@given(st.text())
def test_any_words_make_balanced_latex_and_one_line_of_markdown(words):
    blocks = [
        Heading(level=1, words=words),
        Bullets(items=(words, (CodeSpan(words),))),
        Grid(header=(words, "n"), rows=((words, words),)),
    ]
    check_latex(to_latex(blocks))
    assert len(markdown_tables(to_markdown(blocks[2:]))[0][1]) == 2


def test_many_methods_stay_within_the_page():
    methods = [
        Method(cq=f"bdf{p}", degree=s, sampling="nodes") for p in range(1, 7) for s in (1, 2)
    ]
    made = table_of(lambda run: made_run(run, 1e25, status="diverged"), *methods)
    texts = rendered(order_report("a", [made]))
    assert sum(check_latex(text) for file, text in texts.items() if file.endswith("tex")) > 2
    for line in texts["a.md"].splitlines():
        if line.startswith("|"):
            assert len(line) <= 170
    # and nothing is lost: every method has its errors once
    details = markdown_tables(texts["a.md"])[1:]
    assert sum(line.count("(diverged)") for t in details for line in t) == 12 * 4
    assert all(line[0] == t[k][0] for t in details for k, line in enumerate(details[0]))


# --- compiled ------------------------------------------------------------------------------------


def compiled(folder: Path, texts: dict[str, str]) -> str:
    """The log of a plain article that takes these texts in."""
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    packages = ",".join(PACKAGES)
    size = r"\footnotesize\setlength{\tabcolsep}{4pt}\raggedright"
    inputs = "\n".join(
        rf"{{{'' if name.endswith('-text.tex') else size}\input{{{name}}}\clearpage}}"
        for name in texts
    )
    article = rf"\documentclass{{article}}\usepackage{{{packages}}}\begin{{document}}{inputs}"
    (folder / "all.tex").write_text(article + r"\end{document}", encoding="utf-8")
    # longtable takes its widths from the run before
    for _ in range(2):
        subprocess.run(
            ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "-draftmode", "all.tex"],
            cwd=folder,
            check=False,
            capture_output=True,
            timeout=300,
        )
    return (folder / "all.log").read_text(encoding="latin-1")


def has_latex() -> bool:
    if shutil.which("pdflatex") is None or shutil.which("kpsewhich") is None:
        return False
    names = [f"{package}.sty" for package in PACKAGES]
    found = subprocess.run(["kpsewhich", *names], check=False, capture_output=True, text=True)
    return len(found.stdout.split()) == len(names)


needs_latex = pytest.mark.skipif(not has_latex(), reason="no LaTeX here")


def faults(log: str) -> list[str]:
    """Errors, and what stands out of the text by more than a letter's stroke."""
    wide = [
        line
        for line in log.splitlines()
        if (found := re.match(r"Overfull \\hbox \((\d+\.\d+)pt", line)) and float(found[1]) > 1
    ]
    return [line for line in log.splitlines() if line.startswith("!")] + wide


@needs_latex
def test_every_report_compiles_within_the_page(tmp_path):
    texts = {
        name: text
        for report in every_report()
        for name, text in rendered(report).items()
        if name.endswith(".tex")
    }
    whole = [name for name in texts if name.endswith("-text.tex")]
    assert len(whole) == 3 + len(KINDS)
    assert len(texts) >= 2 * len(whole)
    log = compiled(tmp_path, texts)
    assert faults(log) == []
    assert "Output written" in log or "No pages of output" not in log


@needs_latex
def test_a_table_that_is_too_wide_and_a_mistake_are_found(tmp_path):
    wide = to_latex([Grid(header=("a" * 200, "b"), rows=(("1", "2"),), text_columns=0)])
    assert any("Overfull" in line for line in faults(compiled(tmp_path, {"wide.tex": wide})))
    wrong = to_latex([Paragraph(words="a")]).replace("a\\par", "$a\\par")
    assert any(line.startswith("!") for line in faults(compiled(tmp_path, {"w.tex": wrong})))


@needs_latex
def test_whatever_the_words_they_compile(tmp_path):
    blocks = [
        Heading(level=1, words=HOSTILE),
        Paragraph(words=(Equation(HOSTILE), CodeSpan(HOSTILE))),
        Grid(header=("[a]", HOSTILE), rows=(("[1pt]", HOSTILE),), text_columns=2),
    ]
    report = Report(
        name="words",
        sheets=(Sheet(name="rows", columns=(Column("a", ""),), rows=(), keys=()),),
        words=lambda sheets: alike(blocks),
    )
    texts = {name: text for name, text in rendered(report).items() if name.endswith(".tex")}
    log = compiled(tmp_path, texts)
    assert [line for line in faults(log) if line.startswith("!")] == []
