"""QGIS's enumerations under their names since QGIS 3.36, which QGIS 4 (Qt 6) asks for; QGIS 3.22 has the older ones."""

from qgis.core import Qgis, QgsProcessing, QgsProcessingParameterDefinition, QgsProcessingParameterNumber

if hasattr(Qgis, "ProcessingParameterFlag"):
    ADVANCED = Qgis.ProcessingParameterFlag.Advanced
    OPTIONAL = Qgis.ProcessingParameterFlag.Optional
    INTEGER = Qgis.ProcessingNumberParameterType.Integer
    DOUBLE = Qgis.ProcessingNumberParameterType.Double
    RASTER = Qgis.ProcessingSourceType.Raster
    VECTOR = Qgis.ProcessingSourceType.Vector
else:
    ADVANCED = QgsProcessingParameterDefinition.Flag.FlagAdvanced
    OPTIONAL = QgsProcessingParameterDefinition.Flag.FlagOptional
    INTEGER = QgsProcessingParameterNumber.Type.Integer
    DOUBLE = QgsProcessingParameterNumber.Type.Double
    RASTER = QgsProcessing.SourceType.TypeRaster
    VECTOR = QgsProcessing.SourceType.TypeVector
