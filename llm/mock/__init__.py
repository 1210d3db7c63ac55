"""A rule model behind a real HTTP server. It knows nothing but the prompt it is sent."""
