"""Campaigns over many seeds: how far they are, what they found, and for admins to begin and end."""

import asyncio
from typing import Any

from nicegui import ui
from pydantic import TypeAdapter

from console.board import Board
from console.panel import Panel
from console.panels.parts import choice
from console.render import escape
from server.api.experiment_models import ExperimentRequest
from server.api.identity import Role
from server.api.laboratory import Experiment, Progress
from server.api.service import MissionService

Json = dict[str, Any]

EXPERIMENTS_SHOWN = 12
ROWS_SHOWN = 40
UNDER_WAY = frozenset({Progress.QUEUED, Progress.RUNNING})
HALF_WIDTH = "_half_width"

KINDS = {
    "ablation": "what optimizer, solver, model and person are worth",
    "reasoning": "how often models answer validly",
    "scaling": "time of a tick by team size",
    "runtime": "rates and run times of a live mission",
}
TAKES = {
    "ablation": ("llm", "seeds"),
    "reasoning": ("llm", "seeds"),
    "scaling": ("seeds",),
    "runtime": ("llm",),
}
MODELS = frozenset({"exact", "none"})
"""Profiles that are none."""

_REQUEST: TypeAdapter[Any] = TypeAdapter(ExperimentRequest)


class ExperimentsPanel(Panel):
    """The experiments of this server."""

    styles = ("library.css",)

    @staticmethod
    def stand(board: Board) -> dict[str, str]:
        """Return every experiment with its progress, the newest first."""
        return {"experiments": experiments(board.workshop.laboratory().all())}

    def build(self) -> None:
        """Show the list, the tables of the one that was chosen, and the form for admins."""
        self._shown = ""
        self._chosen: dict[str, str] = {}
        role = " admin" if self.desk.may(Role.ADMIN) else ""
        with ui.element("section").classes(f"library experiments{role}"):
            ui.html("<h3>Experiments</h3>", sanitize=False)
            if role:
                self._form()
            self.desk.taps(self.html("experiments", "rows"), self._tapped)
            self._tables = ui.html("", sanitize=False).classes("found")

    def _form(self) -> None:
        profiles = [p.name for p in self.desk.board.service.profiles() if p.name not in MODELS]
        with ui.element("div").classes("form"):
            self._choice("Kind", list(KINDS), "kind")
            self._choice("Model", profiles, "llm")
            self._choice("Seeds", ["1", "5", "10", "20", "50"], "seeds", "5")
            ui.button("Begin", on_click=self._begin, color=None).props(
                "unelevated no-caps"
            ).classes("go")

    def _choice(self, title: str, options: list[str], key: str, first: str = "") -> None:
        choice(title, options, lambda chosen: self._chosen.update({key: chosen}), first)

    async def _begin(self) -> None:
        kind = self._chosen["kind"]
        asked: Json = {"kind": kind}
        if "seeds" in TAKES[kind]:
            asked["seeds"] = int(self._chosen["seeds"])
        if "llm" in TAKES[kind]:
            llm = self._chosen["llm"]
            asked |= {"llm": llm} if kind == "runtime" else {"llms": [llm]}

        async def begin(service: MissionService, _: str, author: str) -> None:
            request = _REQUEST.validate_python(asked)
            campaign = await asyncio.to_thread(request.campaign, service)
            self.desk.note("begin experiment", **asked)
            self.desk.board.workshop.laboratory().begin(campaign, author)

        await self.desk.act(begin, Role.ADMIN)

    async def _tapped(self, said: str) -> None:
        laboratory = self.desk.board.workshop.laboratory()
        known = {experiment.id for experiment in laboratory.all()}
        match said.split(":"):
            case ["experiment", "show", name] if name in known:
                self._shown = "" if self._shown == name else name
                self._show()
            case ["experiment", "stop", name] if name in known:

                async def stop(_: MissionService, __: str, ___: str) -> None:
                    self.desk.note("stop experiment", experiment=name)
                    await laboratory.stop(name)

                await self.desk.act(stop, Role.ADMIN)

    def _show(self) -> None:
        laboratory = self.desk.board.workshop.laboratory()
        found = next((e for e in laboratory.all() if e.id == self._shown), None)
        self._tables.set_content("" if found is None else tables(found))


def experiments(known: list[Experiment]) -> str:
    """Return experiments as rows with their progress."""
    return "".join(_row(one) for one in known[: -EXPERIMENTS_SHOWN - 1 : -1]) or (
        '<p class="empty">None since the server started.</p>'
    )


def tables(experiment: Experiment) -> str:
    """Return what an experiment found, table by table; empty before it is done."""
    found = (experiment.result or {}).get("tables", {})
    parts = [
        f"<h4>{escape(experiment.id)}: {escape(name.replace('_', ' '))}</h4>{_table(records)}"
        for name, records in found.items()
        if isinstance(records, list) and records
    ]
    return "".join(parts)


def _row(one: Experiment) -> str:
    done, runs = one.done, max(1, one.runs)
    name = escape(one.id)
    act = ""
    if one.state in UNDER_WAY:
        act = (
            f'<button type="button" class="control" data-tap="experiment:stop:{name}">Stop</button>'
        )
    elif one.result is not None:
        act = f'<button type="button" data-tap="experiment:show:{name}">Tables</button>'
    wrong = f'<p class="wrong">{escape(one.error)}</p>' if one.error else ""
    return (
        f'<div class="row" title="{escape(KINDS.get(one.kind, ""))}"><b>{name}</b>'
        f"<span>{escape(one.kind)} <small>{escape(one.author)}</small></span>"
        f'<progress max="{runs}" value="{done}" aria-label="runs done"></progress>'
        f"<small>{done}/{one.runs}</small>"
        f'<span class="chip {one.state.value}">{one.state.value}</span>{act}{wrong}</div>'
    )


def _table(records: list[Json]) -> str:
    keys = [key for key in records[0] if not key.endswith(HALF_WIDTH)]
    head = "".join(f'<th scope="col">{escape(key.replace("_", " "))}</th>' for key in keys)
    rows = "".join(
        f"<tr>{''.join(_cell(record, key) for key in keys)}</tr>" for record in records[:ROWS_SHOWN]
    )
    return (
        f'<div class="wide"><table><thead><tr>{head}</tr></thead>'
        f"<tbody>{rows}</tbody></table></div>"
    )


def _cell(record: Json, key: str) -> str:
    value, half = record.get(key), record.get(key + HALF_WIDTH)
    if value is None:
        return "<td>–</td>"
    if isinstance(value, int | float):
        interval = "" if half is None else f" ± {half:.2g}"
        return f'<td class="num">{value:.4g}{interval}</td>'
    return f"<td>{escape(str(value))}</td>"
