"""The released manifests: one TOML file a data set and version."""
