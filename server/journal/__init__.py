"""The journal: what happened, who caused it and when, in a database that shows tampering."""
