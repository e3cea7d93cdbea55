"""What a compiled program lets its executors assume: goal levels, straight rules, columnar rules, single facts.

The analyses read byte-code alone. The compiler, the virtual machine and the columnar engine use their results.
"""
