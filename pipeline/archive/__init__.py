"""Archives: every log of many voyages through the pipeline, and what they say together.

``sources`` finds the logs, ``stores`` reads and writes wherever they are, ``manifest`` knows what is done, ``working``
does one log in a worker, ``running`` keeps the workers busy; ``catalogue`` gathers what came of it.
"""
