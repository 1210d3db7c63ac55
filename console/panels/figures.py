"""The mission's figures over the scene."""

from console.board import Facts
from console.panel import Panel
from console.render import Json, escape


class FiguresPanel(Panel):
    """Trace, hits and the last solve."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the figures."""
        return {} if facts.picture is None else {"figures": figures(facts.picture)}

    def build(self) -> None:
        """Show them."""
        self.html("figures", "figures")


class AbsencePanel(Panel):
    """Why the scene is empty, or not what it should show, where it is so."""

    @staticmethod
    def draw(facts: Facts) -> dict[str, str]:
        """Return the reason; nothing while there is a picture, and it is drawn."""
        missing = facts.picture is None
        words = facts.service.hindsight.absence(facts.mission.id) if missing else facts.scene_fault
        return {"absence": f"<p>{escape(words)}</p>" if words else ""}

    def build(self) -> None:
        """Show it over the scene."""
        self.html("absence", "absence")


def figures(snapshot: Json) -> str:
    """Return the mission's figures in one line."""
    solve = snapshot["solve"]
    attacks = snapshot["attacks"]
    trace = snapshot["trace"]
    items = [
        ("Trace", "–" if trace is None else f"{trace:.2f} m²", ""),
        ("Sensing hits", str(attacks["sensing"]), ""),
        ("Link hits", str(attacks["communication"]), ""),
    ]
    if solve is not None:
        tone = "" if solve["rung"] == "converged" else "warn"
        items.append(("Solve", f"{solve['solve_ms']:.1f} ms · {escape(solve['rung'])}", tone))
    return "".join(
        f'<div class="figure {tone}"><span>{name}</span><b>{value}</b></div>'
        for name, value, tone in items
    )
