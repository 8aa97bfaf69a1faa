"""One axis of a quadrotor (Feng et al. 2011)."""
