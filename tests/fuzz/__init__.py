"""Files from anybody, made from a grammar, given to every command that reads them.

grammar  Hypothesis draws -> cases: files of each kind, valid, mutated or damaged, and a command.
arena    Case -> verdict, by a process of its own with limits of time and memory.
worker   That process.
campaign  Seed and number -> so many cases, each with its verdict.
kills    Commands that are ended at any instant and started again -> what was lost.
"""
