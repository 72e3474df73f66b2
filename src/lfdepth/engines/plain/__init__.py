"""The numpy engine: every function of the protocol in plain NumPy, to be read and to be compared with."""
