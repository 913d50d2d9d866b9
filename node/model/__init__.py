"""The model runtime: sections, integration methods, named variables."""
