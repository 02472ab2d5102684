"""More knowledge from fewer trials.

regions  the sky cut into cells of equal area
"""
