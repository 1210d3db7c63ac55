from benchmarks.gate import CARELESS, Job, fly, table


def test_the_gate_keeps_a_careless_adviser_from_harm() -> None:
    runs = [fly(Job("ablation", 0, CARELESS, gate, None)) for gate in ("off", "auto")]
    off, auto = runs
    assert off.refused_by_gate == off.forecasts == 0
    assert auto.refused_by_gate > 10
    assert auto.gone_into_force < off.gone_into_force
    assert auto.trace < off.trace
    assert auto.forecast_median_ms > 0.0
    head, _, *rows = table(runs).splitlines()
    assert len(rows) == 2
    assert f"({auto.trace - off.trace:+.1f} ± " in rows[1]
    assert head.count("|") == rows[0].count("|")
