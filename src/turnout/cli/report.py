"""The command `turnout report`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from turnout.cli.options import opened_panel
from turnout.cli.outputs import check_outputs, made_folder, write_told

if TYPE_CHECKING:
    from turnout.report.page import Page


def report_command(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SOURCE", help="A run or a campaign (.nc), or the folder of a campaign."
        ),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", metavar="FILE.html", help="The report.")
    ] = Path("report.html"),
    figures: Annotated[
        Path | None,
        typer.Option("--figures", metavar="DIR", help="Write each figure as PDF, PNG and SVG."),
    ] = None,
    panel: Annotated[
        str | None,
        typer.Option("--panel", metavar="PANEL", help="Panel file of a run, for its origins."),
    ] = None,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Show nothing but errors.")] = False,
) -> None:
    """Write a self-contained page about a run or a campaign: open it in any browser, offline."""
    check_outputs({"--out": out}, {"--out": (".html",)})
    folder = made_folder("--figures", figures) if figures is not None else None
    page = _page(source, panel)
    from turnout.files.atomic import write_atomic
    from turnout.report.page import page_html

    for section in page.sections:
        for picture in section.pictures if folder is not None else ():
            for suffix, content in picture.files.items():
                write_atomic(folder / f"{picture.sheet.name}{suffix}", content)  # type: ignore[operator]
    write_told(out, page_html(page))


def _page(source: Path, panel: str | None) -> "Page":
    from turnout.errors import FileError
    from turnout.report.inputs import panel_of
    from turnout.report.run import run_page
    from turnout.response.store import open_response

    dataset = open_response(source)
    given = opened_panel(panel, []) if panel is not None else None
    used = panel_of(dataset.attrs, panel=given)
    if given is not None and used is None:
        message = (
            f"--panel {panel}: is not the panel of {source}, which is "
            f"'{dataset.attrs.get('panel', 'not stated')}' with other values; name that one"
        )
        raise FileError(message)
    return run_page(dataset, panel=used)
