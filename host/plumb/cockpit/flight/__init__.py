"""A simulated vehicle, steered by hand in the browser.

transmitter  the sticks of the page that holds the vehicle, as bytes of a radio receiver
arming       why the board is not armed, as it says
rivals       other estimators on the same samples
flight_loop  the thread that owns board and vehicle: flights, records, what the pages see
flight_page  what a page of a flight sends and gets, and its files
"""
