"""Floor 1: the language models in the loop. Prompts, client, answers, verification, mock."""
