"""How one robot knows where it is and moves: localisation, path planning, path following, collision avoidance.

Values in, values out: plain floats, no clock, no numpy. `navigator.Navigator` joins the parts for one robot.
"""
