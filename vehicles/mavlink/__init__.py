"""Flying ArduPilot and PX4 vehicles over MAVLink, and a simulated autopilot to fly against."""
