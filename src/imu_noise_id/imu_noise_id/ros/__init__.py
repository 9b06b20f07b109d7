"""Live nodes: parameters, messages to records and back, wiring."""
