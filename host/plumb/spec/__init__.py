"""What both hands obey: messages, parameters, records, units, protocol numbers."""
