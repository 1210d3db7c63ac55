"""Floor 1: wire messages, the bus, the vehicle agent, the simulated world."""
