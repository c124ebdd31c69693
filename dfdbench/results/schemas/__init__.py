"""The published JSON schema of a result."""
