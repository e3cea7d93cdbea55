"""The radio between robots: IEEE 802.15.4 at 2.4 GHz, emulated frame by frame.

| module | holds |
|---|---|
| `frame` | the octets of frames |
| `phy` | power, interference, the rules of reception for one receiver: the specification |
| `links` | what befalls a link besides distance: shadowing, bursts, disturbances |
| `mac` | CSMA/CA, acknowledgements, retries |
| `security` | ciphers and frame counters |
| `receive_filter` | addresses, duplicates and security of a frame that came through |
| `settings` | the settings of a lab's radio, a row each |
| `air`, `cells` | announcements of transmissions, and the cells of the floor by which they are published |
| `station` | the radio of one robot process, which hears of other transmissions by announcements |
| `ether`, `ether_station` | all radios of a lab in virtual time |
| `waves`, `path_loss_map` | what the ether computes for all receivers of a frame at once, as arrays |
| `trials` | experiments |

Nothing here knows what payloads mean.
"""
