"""Mutation testing: does the suite notice when a comparison, sign or constant is wrong?"""
