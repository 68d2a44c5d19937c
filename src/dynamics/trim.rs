//! Steady flight: solves a model's `[trim]` section for the quantities it frees.
