"""The hunt: a search for the smallest list of faults that breaks a property of a run (`rmr sim LAB --hunt`).

It is lineage-driven fault injection (Alvaro, Rosen and Hellerstein, SIGMOD 2015). A good run is observed: on what its
safety rested, and when (`lineage`). Fault lists remove exactly that (`candidates`). Each is run (`hunt_trial`); what a
run that was still good rested on gives the faults that are added to its list (`hunt_search`). A list that breaks a
property is reduced to the smallest that still breaks it, and told as lines of a lab file (`hunt_command`).
"""
