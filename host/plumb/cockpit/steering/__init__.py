"""A simulated vehicle, steered by hand in the browser. A trip is a flight or a ride.

transmitter     the sticks of the page that holds the vehicle, as bytes of a radio receiver
arming          why the board is not armed, as it says
rivals          other estimators on the same samples
steered_boards  the native board, and the flash image on the simulated chip
trip_loop       the thread that owns board and vehicle: trips, records, what the pages see
trip_page       what a page of a trip sends and gets, and its files
"""
