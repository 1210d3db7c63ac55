"""REST and WebSocket under /api/v1, health, and the service they stand on."""
