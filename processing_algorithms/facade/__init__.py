"""Content of `import hrsi`: the declared algorithms as functions, and results with a display for notebooks.

The functions are made from the declarations, as the command line and the QGIS dialogs are; descriptions of the
algorithms are not repeated here.
"""
