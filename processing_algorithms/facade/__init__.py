"""What `import hrsi` offers to people: the declared algorithms as functions, and results that show themselves.

The functions are made from the declarations, as the command line and the QGIS dialogs are; nothing of an algorithm is
said here again.
"""
