"""Floor 0: the vocabulary, the estimators, the optimizer. Knows no I/O and no asyncio."""
