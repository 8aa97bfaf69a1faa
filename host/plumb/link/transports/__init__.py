"""Ways to carry frames: serial ports, CAN adapters, TCP, socketcand, and servers of them."""
