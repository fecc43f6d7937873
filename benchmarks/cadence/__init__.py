"""The whole step at its true cadence: car and controller in two processes, every 25 ms."""
