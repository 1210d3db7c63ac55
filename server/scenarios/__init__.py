"""Scenario files: ours and the paper authors', checked, and what is made of them."""
