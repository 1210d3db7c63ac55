"""Many people and programs at one server: what it costs the mission, and each of them."""
