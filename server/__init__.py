"""Floor 2: scenarios, the mission, its loops, REST and WebSocket, the command line."""
