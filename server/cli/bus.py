"""Where a vehicle or a world finds the bus: as asked, as the settings say, or here."""

from server.bus import vehicle_bus
from server.settings import load_settings
from vehicles.zenoh_settings import ZenohSettings

DEFAULT_BUS = "tcp/127.0.0.1:7447"


def bus_of(endpoints: str | None) -> ZenohSettings:
    """Return the session of who is no planner, credentials from the settings.

    Raises server.settings.SettingsError.
    """
    settings = load_settings(zenoh_connect=endpoints)
    if settings.zenoh_connect is None:
        settings = settings.model_copy(update={"zenoh_connect": DEFAULT_BUS})
    return vehicle_bus(settings)
