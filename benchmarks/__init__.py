"""Programs that measure what the design promises."""
