"""The radio between robots: IEEE 802.15.4 at 2.4 GHz, emulated frame by frame.

`frame` knows octets, `phy` power, interference and chance, `links` what happens to a link besides distance, `mac`
CSMA/CA, acknowledgements and retries, `security` ciphers and counters, `intake` what becomes of a frame that has come
through. They are joined twice: `station` is the radio of one robot process, which hears of the others by what they
announce (`air`, told to those in the `cells` around); `ether` is all radios of a lab in virtual time (`etherstation`,
and `floor`, `waves` and `tallies` as arrays). `trials` are experiments. Nothing here knows what payloads mean.
"""
