"""Where a world or a vehicle looks for the bus."""

import pytest

from server.cli.bus import DEFAULT_BUS, bus_of
from server.cli.simulate import sim
from vehicles.sim_job import SimulationJob


def test_it_is_as_asked_else_as_set_else_on_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    assert bus_of(None).connect == (DEFAULT_BUS,)
    monkeypatch.setenv("FALCONER_ZENOH_CONNECT", "tcp/192.0.2.1:7447,tcp/192.0.2.2:7447")
    assert bus_of(None).connect == ("tcp/192.0.2.1:7447", "tcp/192.0.2.2:7447")
    assert bus_of("tcp/192.0.2.3:7447").connect == ("tcp/192.0.2.3:7447",)


def test_a_world_connects_where_the_settings_say(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    jobs: list[SimulationJob] = []

    async def simulated(job: SimulationJob) -> None:
        jobs.append(job)

    monkeypatch.setattr("vehicles.sim_worker.simulate", simulated)
    monkeypatch.setattr("server.cli.simulate.log_to_stderr", lambda: None)
    monkeypatch.setenv("FALCONER_ZENOH_CONNECT", "tcp/192.0.2.1:7447")
    sim("hardware")
    assert jobs[0].zenoh.connect == ("tcp/192.0.2.1:7447",)
    assert "on tcp/192.0.2.1:7447" in capsys.readouterr().err
