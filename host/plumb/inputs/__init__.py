"""Sources of samples: recordings, the sensor board, the bridge between two buses."""
