"""Transports: serial ports, CAN adapters, TCP, UDP and socketcand, as clients and as servers."""
