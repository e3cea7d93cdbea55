"""Validation of a lab before it runs; the same for `rmr sim`, `rmr up`, `rmr world`, `rmr check` and `rmr.simulate`.

    phase            looks at                    finds                                               modules
    1 schema         each key of the lab file    unknown keys, wrong types and units                 schema_*
    2 fit            the file's parts together   overlaps, unknown names                             lab_draft, *_fit
                     the lab and its program     areas and facts that one has and the other lacks    program_fit
    3 reachability   floor and program           places without a way                                reachability
    4 feasibility    time, room, turns           deadlines that nothing meets, unused bottlenecks    all others

Phases 1 to 3 find errors, phase 4 warnings: such a run is possible, and missing a deadline may be its purpose. A check
is a function of one rule that yields findings (`rmr_world.finding`); `pipeline` runs the phases in order.
"""
