"""The stages: each reads artifacts, works, and writes one artifact. They meet in the store and do not call each other.

Only `chain` calls them, one after another.
"""
