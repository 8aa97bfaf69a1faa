"""Text tables of IMU loggers: what the words of a header mean, and how cells are separated."""
