"""A team on two sites whose link is slow, loses packets and is cut."""
