"""The stages: each reads artifacts, works, and writes one artifact. They meet in the store and never call each other.

`chain` alone calls them, one after the other.
"""
