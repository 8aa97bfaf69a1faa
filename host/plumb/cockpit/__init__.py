"""A live page of a board in the browser: plots, attitude, health, arming, parameters, recordings.

samples      the signals of every step, as rows of a ring that every page reads at its own pace
hold         who may write: the page that holds the board, as long as its heartbeat comes
board_run    the run that is on: begun or joined, followed, compared, noticed to be over
board_loop   the thread that owns the link to the board: turns, orders, what the pages see
page_orders  what a page asks for, checked
steering     a simulated vehicle that is steered by hand, in place of a board that is watched
page_server  serves the page and its WebSocket on the loopback interface
"""
