"""The gate: what a verified proposal is predicted to do, and the decisions that come of it."""
