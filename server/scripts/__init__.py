"""Scripted missions: a small client that steers a server over REST and comes to a verdict."""
