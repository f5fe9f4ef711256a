"""Is a recording what its sensors should have given?"""
