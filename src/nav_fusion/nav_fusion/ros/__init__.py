"""Live nodes: parameters, messages to the filter's inputs and back, wiring."""
