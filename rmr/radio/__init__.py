"""The radio between robots: IEEE 802.15.4 at 2.4 GHz, simulated frame by frame.

`frame` knows octets, `phy` knows power, interference and chance, `mac` knows CSMA/CA, acknowledgements and
retries, and `station` joins the three into the radio of one robot. Nothing here knows what payloads mean.
"""
