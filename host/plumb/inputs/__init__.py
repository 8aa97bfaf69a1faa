"""Where samples come from: recordings, the sensor board, the bridge between two buses."""
