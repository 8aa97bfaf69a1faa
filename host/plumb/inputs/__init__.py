"""Where samples come from: recordings, phones, the sensor board, the bridge between two buses."""
