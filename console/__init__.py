"""Floor 3: the web page and the 3D scene."""
