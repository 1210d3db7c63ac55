"""The simulated world: robots, targets, danger zones and their dice.

It never plans and never estimates. One setup and one seed give one world: every chance event
has its own counter-based random number (purpose, robot, zone or target, step), so that two
policies under one seed meet the same dice.
"""
