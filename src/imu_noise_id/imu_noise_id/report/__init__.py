"""The report: one page of figures and tables that works offline.

``page`` knows figures, tables and sections and nothing of noise; other packages build their own
pages with it.  ``curves`` makes small arrays of long recordings, ``figures`` draws them.
"""
