"""Logs of frames: the file, which never blocks the loop, its formats, and the recorder."""
