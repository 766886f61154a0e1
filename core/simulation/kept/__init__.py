"""Machine code, and the classes of which reduced models are kept."""
