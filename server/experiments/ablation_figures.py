"""The ablation's two figures."""

from server.experiments import figures
from server.experiments.ablation import TRADE_OFF, Ablation
from server.experiments.figures import Bar, Mark
from server.experiments.merit import COMMUNICATION, MERIT, SENSING, TRACE


def draw(ablation: Ablation) -> dict[str, bytes]:
    """Return the figures as PNG by the name of their file."""
    scenario, seeds = ablation.plan.scenario.name, len(ablation.plan.seeds)
    panels = {
        figure.head: [
            Bar(row, ablation.mean(row, figure), list(ablation.by_seed(row, figure).values()))
            for row in ablation.rows()
        ]
        for figure in (TRACE, SENSING, COMMUNICATION, MERIT)
    }
    drawn = {
        "ablation": figures.bars(panels, f"{scenario}, {seeds} seeds, means and 95 % intervals")
    }
    settings = [
        name for name, row in ablation.figures.items() if row and name.startswith(TRADE_OFF)
    ]
    if settings:
        drawn["trade-off"] = figures.trade_off(
            _marks(ablation, settings),
            _marks(ablation, ablation.rows()),
            ("accumulated trace", "attacks, both kinds"),
            f"{scenario}: trace against attacks over weights of safety",
        )
    return drawn


def _marks(ablation: Ablation, rows: list[str] | tuple[str, ...]) -> list[Mark]:
    marks = []
    for row in rows:
        trace, attacks = ablation.mean(row, TRACE), ablation.attacks(row)
        if trace is not None and attacks is not None:
            marks.append(Mark(row.removeprefix(TRADE_OFF), trace, attacks))
    return marks
