"""The link to a board: transports, session, lockstep, real time, identity."""
