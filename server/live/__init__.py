"""The live mission: its own process, and the line by which the web side talks with it."""
