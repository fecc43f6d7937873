"""The whole step in real time: vehicle and controller in two processes, once a period."""
