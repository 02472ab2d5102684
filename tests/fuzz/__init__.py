"""Files from anybody, made from a grammar, given to every command that reads them.

grammar  Random draws -> cases: files of each kind, valid, mutated or damaged, and a command.
exchange  The same of what is exchanged with others: code, sketches, guide stars, recordings.
parts    Code that a design may name, none of which does what it should.
arena    Case -> verdict, by a process of its own with limits of time and memory.
worker   That process.
campaign  Seed and number -> so many cases, each with its verdict.
kills    Commands that are ended at any instant and started again -> what was lost.
"""
