"""Files from anybody, made from a grammar, given to every command that reads them.

grammar  Hypothesis draws -> cases: files of each kind, valid, mutated or damaged, and a command.
arena    Case -> verdict, by a process of its own with limits of time and memory.
worker   That process.
"""
