"""Floor 1: prompts, the model client, parsing and verification of answers, the mock endpoint."""
