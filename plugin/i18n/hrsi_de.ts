<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="de" sourcelanguage="en">
  <context>
    <name>HRSI</name>
    <message>
      <source>(about {} min left)</source>
      <translation>(noch etwa {} min)</translation>
    </message>
    <message>
      <source>(about {} s left)</source>
      <translation>(noch etwa {} s)</translation>
    </message>
    <message>
      <source>({} more in the report)</source>
      <translation>({} weitere im Bericht)</translation>
    </message>
    <message>
      <source>, outside the image</source>
      <translation>, außerhalb des Bildes</translation>
    </message>
    <message>
      <source>1 GCP: no check possible</source>
      <translation>1 Passpunkt: keine Kontrolle möglich</translation>
    </message>
    <message>
      <source>1 image chosen</source>
      <translation>1 Bild gewählt</translation>
    </message>
    <message>
      <source>1. Load the example: three simulated satellite images, six GCPs and twelve check points. One GCP is not measured on one image yet.</source>
      <translation>1. Beispiel laden: drei simulierte Satellitenbilder, sechs Passpunkte und zwölf Kontrollpunkte. Ein Passpunkt ist in einem Bild noch nicht gemessen.</translation>
    </message>
    <message>
      <source>2. Measure it: the framed view shows where the camera puts the GCP (blue ring). Click near the disc; its centre is found to a few hundredths of a pixel.</source>
      <translation>2. Messen: Die umrahmte Ansicht zeigt, wo die Kamera den Passpunkt erwartet (blauer Ring). In die Nähe der Scheibe klicken; ihre Mitte wird auf wenige Hundertstel Pixel gefunden.</translation>
    </message>
    <message>
      <source>3. Adjust: the cameras of all images are refined at once. The verdict shows whether the result can be used.</source>
      <translation>3. Ausgleichen: Die Kameras aller Bilder werden gemeinsam verbessert. Das Urteil zeigt, ob das Ergebnis brauchbar ist.</translation>
    </message>
    <message>
      <source>4. Look at the residuals: the block is saved, and residual arrows are shown on the map, in red where a point does not fit.</source>
      <translation>4. Residuen ansehen: Der Block wird gespeichert, und die Karte zeigt Residuenpfeile, rot, wo ein Punkt nicht passt.</translation>
    </message>
    <message>
      <source>; no closed target here, clicked position used</source>
      <translation>; hier ist kein geschlossenes Ziel, die angeklickte Stelle gilt</translation>
    </message>
    <message>
      <source>A DEM of the ground</source>
      <translation>Ein DGM des Geländes</translation>
    </message>
    <message>
      <source>A block adjusted before, which the images join</source>
      <translation>Der früher ausgeglichene Block, zu dem die Bilder kommen</translation>
    </message>
    <message>
      <source>A click shows the residuals of the points concerned, the worst first</source>
      <translation>Ein Klick zeigt die Residuen der betroffenen Punkte, die schlechtesten zuerst</translation>
    </message>
    <message>
      <source>A project folder for another program from an adjusted block, ready to run</source>
      <translation>Lauffertiger Projektordner für ein anderes Programm aus einem ausgeglichenen Block</translation>
    </message>
    <message>
      <source>A reference orthoimage</source>
      <translation>Ein Referenz-Orthobild</translation>
    </message>
    <message>
      <source>A required DEM</source>
      <translation>Ein DGM (nötig)</translation>
    </message>
    <message>
      <source>A required reference orthoimage</source>
      <translation>Ein Referenz-Orthobild (nötig)</translation>
    </message>
    <message>
      <source>A surface that constrains a block in plan and height, its datum and accuracy</source>
      <translation>Eine Oberfläche, die einen Block in Lage und Höhe hält, ihr Datum und ihre Genauigkeit</translation>
    </message>
    <message>
      <source>A synthetic block with images, DEM, GCPs, noise and full truth</source>
      <translation>Ein synthetischer Block mit Bildern, DGM, Passpunkten, Rauschen und allen wahren Werten</translation>
    </message>
    <message>
      <source>Accept</source>
      <translation>Annehmen</translation>
    </message>
    <message>
      <source>Accept all</source>
      <translation>Alle annehmen</translation>
    </message>
    <message>
      <source>Accept the match in the active view</source>
      <translation>Die Zuordnung in der aktiven Ansicht annehmen</translation>
    </message>
    <message>
      <source>Accept the matches in all images</source>
      <translation>Die Zuordnungen in allen Bildern annehmen</translation>
    </message>
    <message>
      <source>Accuracy of one or more sets of RPCs with tracks, ground points and a DEM</source>
      <translation>Genauigkeit eines oder mehrerer RPC-Sätze mit Tracks, Geländepunkten und einem DGM</translation>
    </message>
    <message>
      <source>Across</source>
      <translation>Quer zum Flug</translation>
    </message>
    <message>
      <source>Add ground points</source>
      <translation>Bodenpunkte hinzufügen</translation>
    </message>
    <message>
      <source>Add points…</source>
      <translation>Punkte hinzufügen…</translation>
    </message>
    <message>
      <source>Add raster layers of the project</source>
      <translation>Rasterlayer des Projekts hinzufügen</translation>
    </message>
    <message>
      <source>Add the ground points of a layer or file</source>
      <translation>Bodenpunkte eines Layers oder einer Datei hinzufügen</translation>
    </message>
    <message>
      <source>Add to</source>
      <translation>Anfügen an</translation>
    </message>
    <message>
      <source>Adjust</source>
      <translation>Ausgleichen</translation>
    </message>
    <message>
      <source>Adjust again after every change of the measurements</source>
      <translation>Nach jeder Änderung der Messungen neu ausgleichen</translation>
    </message>
    <message>
      <source>Adjust block</source>
      <translation>Block ausgleichen</translation>
    </message>
    <message>
      <source>Adjust the block with the present measurements</source>
      <translation>Den Block mit den vorhandenen Messungen ausgleichen</translation>
    </message>
    <message>
      <source>All</source>
      <translation>Alle</translation>
    </message>
    <message>
      <source>All images</source>
      <translation>Alle Bilder</translation>
    </message>
    <message>
      <source>All packages that matching needs are there.</source>
      <translation>Alle Pakete für die Bildzuordnung sind da.</translation>
    </message>
    <message>
      <source>All steps of a project: triangulate, surface model, orthorectify, check, evaluate</source>
      <translation>Alle Schritte eines Projekts: triangulieren, Oberflächenmodell, orthorektifizieren, prüfen, auswerten</translation>
    </message>
    <message>
      <source>Along</source>
      <translation>Längs zum Flug</translation>
    </message>
    <message>
      <source>An RPC from a grid or table of correspondences</source>
      <translation>Ein RPC aus einem Gitter oder einer Tabelle von Entsprechungen</translation>
    </message>
    <message>
      <source>Apart</source>
      <translation>Mindestabstand</translation>
    </message>
    <message>
      <source>Automatic tie points of a block</source>
      <translation>Automatische Verknüpfungspunkte eines Blocks</translation>
    </message>
    <message>
      <source>Band</source>
      <translation>Kanal</translation>
    </message>
    <message>
      <source>Before</source>
      <translation>Vorher</translation>
    </message>
    <message>
      <source>Before the last edits:</source>
      <translation>Vor den letzten Änderungen:</translation>
    </message>
    <message>
      <source>Begin a block with images and points</source>
      <translation>Einen Block mit Bildern und Punkten beginnen</translation>
    </message>
    <message>
      <source>Block adjustment</source>
      <translation>Blockausgleichung</translation>
    </message>
    <message>
      <source>Blunder size</source>
      <translation>Größe grober Fehler</translation>
    </message>
    <message>
      <source>Blunders</source>
      <translation>Grobe Fehler</translation>
    </message>
    <message>
      <source>Bundle block adjustment from existing image points</source>
      <translation>Bündelblockausgleichung aus vorhandenen Bildpunkten</translation>
    </message>
    <message>
      <source>CRS</source>
      <translation>KBS</translation>
    </message>
    <message>
      <source>CRS if the file has none</source>
      <translation>KBS, wenn die Datei keines hat</translation>
    </message>
    <message>
      <source>Cancel</source>
      <translation>Abbrechen</translation>
    </message>
    <message>
      <source>Cancelled; nothing was written</source>
      <translation>Abgebrochen; nichts wurde geschrieben</translation>
    </message>
    <message>
      <source>Cell</source>
      <translation>Zelle</translation>
    </message>
    <message>
      <source>Cells</source>
      <translation>Zellen</translation>
    </message>
    <message>
      <source>Check as ties</source>
      <translation>Kontrollpunkte verknüpfen</translation>
    </message>
    <message>
      <source>Check ids</source>
      <translation>Namen der Kontrollpunkte</translation>
    </message>
    <message>
      <source>Check orthoimages</source>
      <translation>Orthobilder prüfen</translation>
    </message>
    <message>
      <source>Checks</source>
      <translation>Kontrollpunkte</translation>
    </message>
    <message>
      <source>Chip library</source>
      <translation>Chip-Bibliothek</translation>
    </message>
    <message>
      <source>Chip library…</source>
      <translation>Chip-Bibliothek…</translation>
    </message>
    <message>
      <source>Choose a file</source>
      <translation>Datei wählen</translation>
    </message>
    <message>
      <source>Choose a ground point in the list first</source>
      <translation>Zuerst einen Bodenpunkt in der Liste wählen</translation>
    </message>
    <message>
      <source>Click in an image on a detail that the other images show too: it becomes a tie point</source>
      <translation>In einem Bild auf etwas klicken, das auch die anderen Bilder zeigen: es wird ein Verknüpfungspunkt</translation>
    </message>
    <message>
      <source>Click in an image: a new tie point, searched for in the other images</source>
      <translation>In ein Bild klicken: dort entsteht ein Verknüpfungspunkt, der in den anderen gesucht wird</translation>
    </message>
    <message>
      <source>Click in the framed view of {}</source>
      <translation>In die umrahmte Ansicht von {} klicken</translation>
    </message>
    <message>
      <source>Click in the map where the new point is</source>
      <translation>In der Karte klicken, wo der neue Punkt liegt</translation>
    </message>
    <message>
      <source>Click in the map: a new ground point there, with the height of a DEM</source>
      <translation>In die Karte klicken: dort entsteht ein Bodenpunkt, mit der Höhe eines DGM</translation>
    </message>
    <message>
      <source>Click in the map: the images show that place</source>
      <translation>In die Karte klicken: die Bilder zeigen diese Stelle</translation>
    </message>
    <message>
      <source>Click in the map: the images show that place, at the points' middle height</source>
      <translation>In die Karte klicken: die Bilder zeigen diese Stelle, in der mittleren Höhe der Punkte</translation>
    </message>
    <message>
      <source>Click on</source>
      <translation>Klick auf</translation>
    </message>
    <message>
      <source>Client</source>
      <translation>Auftraggeber</translation>
    </message>
    <message>
      <source>Cliffs</source>
      <translation>Steilwände</translation>
    </message>
    <message>
      <source>Close</source>
      <translation>Schließen</translation>
    </message>
    <message>
      <source>Coefficient covariance</source>
      <translation>Kovarianz der Koeffizienten</translation>
    </message>
    <message>
      <source>Common denominator</source>
      <translation>Gemeinsamer Nenner</translation>
    </message>
    <message>
      <source>Compare</source>
      <translation>Vergleichen</translation>
    </message>
    <message>
      <source>Compare before and after</source>
      <translation>Vorher und nachher vergleichen</translation>
    </message>
    <message>
      <source>Compression</source>
      <translation>Komprimierung</translation>
    </message>
    <message>
      <source>Consistency</source>
      <translation>Übereinstimmung</translation>
    </message>
    <message>
      <source>Contrast</source>
      <translation>Kontrast</translation>
    </message>
    <message>
      <source>Corners, super points and gravity centres of images as a point layer</source>
      <translation>Ecken, Superpunkte und Schwerpunkte von Bildern als Punktlayer</translation>
    </message>
    <message>
      <source>Correlation</source>
      <translation>Korrelation</translation>
    </message>
    <message>
      <source>Corresponding points of two images or windows, without RPC, by control networks</source>
      <translation>Homologe Punkte zweier Bilder oder Ausschnitte, ohne RPC, mit Punktnetzen</translation>
    </message>
    <message>
      <source>Crop or resample</source>
      <translation>Ausschneiden oder umrechnen</translation>
    </message>
    <message>
      <source>Cropped images</source>
      <translation>Ausgeschnittene Bilder</translation>
    </message>
    <message>
      <source>Cross validate</source>
      <translation>Kreuzvalidieren</translation>
    </message>
    <message>
      <source>Csv</source>
      <translation>CSV</translation>
    </message>
    <message>
      <source>DEM</source>
      <translation>DGM</translation>
    </message>
    <message>
      <source>DEM datum</source>
      <translation>Höhenbezug des DGM</translation>
    </message>
    <message>
      <source>Dates</source>
      <translation>Aufnahmetage</translation>
    </message>
    <message>
      <source>Delete the measurement in the active view</source>
      <translation>Die Messung in der aktiven Ansicht löschen</translation>
    </message>
    <message>
      <source>Dense</source>
      <translation>Dicht</translation>
    </message>
    <message>
      <source>Detect interest points</source>
      <translation>Merkmalspunkte suchen</translation>
    </message>
    <message>
      <source>Detector</source>
      <translation>Detektor</translation>
    </message>
    <message>
      <source>Digital surface model (DSM) of an adjusted block by dense matching</source>
      <translation>Digitales Oberflächenmodell (DOM) eines ausgeglichenen Blocks durch dichte Zuordnung</translation>
    </message>
    <message>
      <source>Discard</source>
      <translation>Verwerfen</translation>
    </message>
    <message>
      <source>Do not show this again</source>
      <translation>Nicht mehr zeigen</translation>
    </message>
    <message>
      <source>Earlier cameras</source>
      <translation>Frühere Kameras</translation>
    </message>
    <message>
      <source>Edges</source>
      <translation>Kanten</translation>
    </message>
    <message>
      <source>Ellipsoidal height (m)</source>
      <translation>Ellipsoidische Höhe (m)</translation>
    </message>
    <message>
      <source>Error px</source>
      <translation>Fehler</translation>
    </message>
    <message>
      <source>Errors of the measurements</source>
      <translation>Fehler der Messungen</translation>
    </message>
    <message>
      <source>Errors of the vendor's orientation that are not random</source>
      <translation>Nicht zufällige Fehler der Orientierung des Anbieters</translation>
    </message>
    <message>
      <source>Evaluate RPCs</source>
      <translation>RPCs beurteilen</translation>
    </message>
    <message>
      <source>Extent</source>
      <translation>Ausdehnung</translation>
    </message>
    <message>
      <source>Factor</source>
      <translation>Faktor</translation>
    </message>
    <message>
      <source>Fields of the GCPs</source>
      <translation>Felder der Passpunkte</translation>
    </message>
    <message>
      <source>File of laser points and its height datum</source>
      <translation>Datei mit Laserpunkten und ihr Höhenbezug</translation>
    </message>
    <message>
      <source>Files of ground and image points, and which points are control</source>
      <translation>Dateien mit Boden- und Bildpunkten, und welche Punkte Passpunkte sind</translation>
    </message>
    <message>
      <source>Fill gaps</source>
      <translation>Lücken füllen</translation>
    </message>
    <message>
      <source>Find tie points</source>
      <translation>Verknüpfungspunkte suchen</translation>
    </message>
    <message>
      <source>First</source>
      <translation>Erstes</translation>
    </message>
    <message>
      <source>First steps</source>
      <translation>Erste Schritte</translation>
    </message>
    <message>
      <source>Fit RPC</source>
      <translation>RPC bestimmen</translation>
    </message>
    <message>
      <source>Fixed images</source>
      <translation>Festgehaltene Bilder</translation>
    </message>
    <message>
      <source>Folder</source>
      <translation>Ordner</translation>
    </message>
    <message>
      <source>Footprint, GSD, incidence and azimuth, convergence and B/H of pairs, overlaps, check of the RPCs</source>
      <translation>Bildfläche, Bodenpixelgröße, Einfallswinkel und Azimut, Konvergenz und B/H von Paaren, Überdeckungen, Prüfung der RPCs</translation>
    </message>
    <message>
      <source>Force write</source>
      <translation>Trotzdem schreiben</translation>
    </message>
    <message>
      <source>Forget</source>
      <translation>Löschen</translation>
    </message>
    <message>
      <source>Format</source>
      <translation>Format</translation>
    </message>
    <message>
      <source>Free DEM</source>
      <translation>Freies DGM</translation>
    </message>
    <message>
      <source>Free DEM common</source>
      <translation>Freies DGM, gemeinsamer Fehler</translation>
    </message>
    <message>
      <source>Free DEM correlation</source>
      <translation>Freies DGM, Korrelationslänge</translation>
    </message>
    <message>
      <source>Free DEM noise</source>
      <translation>Freies DGM, Rauschen</translation>
    </message>
    <message>
      <source>Free DEM place</source>
      <translation>Freies DGM, Lagefehler</translation>
    </message>
    <message>
      <source>Free DEM tree height</source>
      <translation>Freies DGM, Baumhöhe</translation>
    </message>
    <message>
      <source>Free DEM trees</source>
      <translation>Freies DGM, Anteil Bäume</translation>
    </message>
    <message>
      <source>Free ortho</source>
      <translation>Freies Orthobild</translation>
    </message>
    <message>
      <source>Free ortho change</source>
      <translation>Freies Orthobild, Veränderung</translation>
    </message>
    <message>
      <source>Free ortho corner</source>
      <translation>Freies Orthobild, Eckenfehler</translation>
    </message>
    <message>
      <source>Free ortho error</source>
      <translation>Freies Orthobild, Lagefehler</translation>
    </message>
    <message>
      <source>GCP blunders</source>
      <translation>Grobe Fehler der Passpunkte</translation>
    </message>
    <message>
      <source>GCP epoch</source>
      <translation>Epoche der Passpunkte</translation>
    </message>
    <message>
      <source>GCP field: height</source>
      <translation>Passpunktfeld: Höhe</translation>
    </message>
    <message>
      <source>GCP field: id</source>
      <translation>Passpunktfeld: Name</translation>
    </message>
    <message>
      <source>GCP field: sigma east</source>
      <translation>Passpunktfeld: Standardabweichung Ost</translation>
    </message>
    <message>
      <source>GCP field: sigma height</source>
      <translation>Passpunktfeld: Standardabweichung Höhe</translation>
    </message>
    <message>
      <source>GCP field: sigma north</source>
      <translation>Passpunktfeld: Standardabweichung Nord</translation>
    </message>
    <message>
      <source>GCP ids</source>
      <translation>Namen der Passpunkte</translation>
    </message>
    <message>
      <source>GCPs</source>
      <translation>Passpunkte</translation>
    </message>
    <message>
      <source>GCPs by matching raw images to a reference orthoimage and DEM</source>
      <translation>Passpunkte durch Zuordnung der Rohbilder zu einem Referenz-Orthobild mit DGM</translation>
    </message>
    <message>
      <source>GCPs from reference image</source>
      <translation>Passpunkte aus Referenzbild</translation>
    </message>
    <message>
      <source>GSD</source>
      <translation>Bodenpixel</translation>
    </message>
    <message>
      <source>Gamma of this image: above 1 it is brighter; its contrast is 2-98 % of what is in view</source>
      <translation>Gamma dieses Bildes: über 1 wird es heller; sein Kontrast umfasst 2-98 % des Ausschnitts</translation>
    </message>
    <message>
      <source>Go to place</source>
      <translation>Kartenstelle zeigen</translation>
    </message>
    <message>
      <source>Ground CRS</source>
      <translation>KBS der Bodenpunkte</translation>
    </message>
    <message>
      <source>Ground points</source>
      <translation>Bodenpunkte</translation>
    </message>
    <message>
      <source>Ground points to image coordinates, for a point file or as a filter</source>
      <translation>Bodenpunkte in Bildkoordinaten, für eine Punktdatei oder als Filter</translation>
    </message>
    <message>
      <source>HRSI Points</source>
      <translation>HRSI Punkte</translation>
    </message>
    <message>
      <source>HRSI: adjusting the block</source>
      <translation>HRSI: Blockausgleichung</translation>
    </message>
    <message>
      <source>HRSI: block adjustment of satellite images with RPCs</source>
      <translation>HRSI: Blockausgleichung von Satellitenbildern mit RPCs</translation>
    </message>
    <message>
      <source>HRSI: first steps</source>
      <translation>HRSI: erste Schritte</translation>
    </message>
    <message>
      <source>HRSI: installing packages</source>
      <translation>HRSI: Pakete werden installiert</translation>
    </message>
    <message>
      <source>HRSI: making the example</source>
      <translation>HRSI: Beispiel wird erzeugt</translation>
    </message>
    <message>
      <source>HRSI: packages for matching</source>
      <translation>HRSI: Pakete für die Bildzuordnung</translation>
    </message>
    <message>
      <source>Hand over to another program</source>
      <translation>An ein anderes Programm übergeben</translation>
    </message>
    <message>
      <source>Heading</source>
      <translation>Flugrichtung</translation>
    </message>
    <message>
      <source>Height</source>
      <translation>Höhe</translation>
    </message>
    <message>
      <source>Height datum</source>
      <translation>Höhenbezug</translation>
    </message>
    <message>
      <source>Height from</source>
      <translation>Höhe aus</translation>
    </message>
    <message>
      <source>Height of the ground</source>
      <translation>Höhe des Geländes</translation>
    </message>
    <message>
      <source>Heights of the DEM refer to</source>
      <translation>Höhenbezug des DGM</translation>
    </message>
    <message>
      <source>Heights refer to</source>
      <translation>Höhenbezug</translation>
    </message>
    <message>
      <source>Hold out</source>
      <translation>Zurückhalten</translation>
    </message>
    <message>
      <source>How a surface model is matched</source>
      <translation>Wie ein Oberflächenmodell zugeordnet wird</translation>
    </message>
    <message>
      <source>How corners are found, on the strength of the normalised image</source>
      <translation>Wie Ecken gefunden werden, nach der Stärke im normierten Bild</translation>
    </message>
    <message>
      <source>How gravity centres are found</source>
      <translation>Wie Schwerpunkte gefunden werden</translation>
    </message>
    <message>
      <source>How many points a block gets</source>
      <translation>Wie viele Punkte ein Block bekommt</translation>
    </message>
    <message>
      <source>How to adjust</source>
      <translation>Ausgleichung</translation>
    </message>
    <message>
      <source>How to find tie points</source>
      <translation>Suche nach Verknüpfungspunkten: Einstellungen</translation>
    </message>
    <message>
      <source>How to refine an image from its GCPs</source>
      <translation>Wie ein Bild aus seinen Passpunkten verbessert wird</translation>
    </message>
    <message>
      <source>How two images are registered</source>
      <translation>Wie zwei Bilder einander angepasst werden</translation>
    </message>
    <message>
      <source>How two windows are matched</source>
      <translation>Wie zwei Fenster einander zugeordnet werden</translation>
    </message>
    <message>
      <source>How windows are matched</source>
      <translation>Wie Fenster einander zugeordnet werden</translation>
    </message>
    <message>
      <source>Id</source>
      <translation>Name</translation>
    </message>
    <message>
      <source>Image points</source>
      <translation>Bildkoordinaten</translation>
    </message>
    <message>
      <source>Image points (optional)</source>
      <translation>Bildkoordinaten (wahlweise)</translation>
    </message>
    <message>
      <source>Image points to the ground, at a height or on a DEM, for a point file or as a filter</source>
      <translation>Bildpunkte auf den Boden, in einer Höhe oder auf einem DGM, für eine Punktdatei oder als Filter</translation>
    </message>
    <message>
      <source>Images</source>
      <translation>Bilder</translation>
    </message>
    <message>
      <source>Images and RPC files</source>
      <translation>Bilder und RPC-Dateien</translation>
    </message>
    <message>
      <source>Images or RPC files</source>
      <translation>Bilder oder RPC-Dateien</translation>
    </message>
    <message>
      <source>Images with refined RPCs</source>
      <translation>Bilder mit verbesserten RPCs</translation>
    </message>
    <message>
      <source>Images with their RPCs</source>
      <translation>Bilder mit ihren RPCs</translation>
    </message>
    <message>
      <source>Incidence</source>
      <translation>Einfallswinkel</translation>
    </message>
    <message>
      <source>Install</source>
      <translation>Installieren</translation>
    </message>
    <message>
      <source>Installed. Matching works now.</source>
      <translation>Installiert. Die Bildzuordnung geht jetzt.</translation>
    </message>
    <message>
      <source>Jitter</source>
      <translation>Lageschwingung</translation>
    </message>
    <message>
      <source>Jitter period</source>
      <translation>Periode der Lageschwingung</translation>
    </message>
    <message>
      <source>Join strip</source>
      <translation>Streifen zusammensetzen</translation>
    </message>
    <message>
      <source>Kappa</source>
      <translation>Kappa</translation>
    </message>
    <message>
      <source>Keep chips of measured GCPs in a file, and find these GCPs in new images by matching</source>
      <translation>Bildausschnitte gemessener Passpunkte in einer Datei sammeln und diese Passpunkte in neuen Bildern durch Bildzuordnung finden</translation>
    </message>
    <message>
      <source>Kind</source>
      <translation>Art</translation>
    </message>
    <message>
      <source>Laboratory</source>
      <translation>Labor</translation>
    </message>
    <message>
      <source>Landform</source>
      <translation>Geländeform</translation>
    </message>
    <message>
      <source>Largest</source>
      <translation>Größter</translation>
    </message>
    <message>
      <source>Laser</source>
      <translation>Laserpunkte</translation>
    </message>
    <message>
      <source>Laser canopy</source>
      <translation>Laser auf Bewuchs</translation>
    </message>
    <message>
      <source>Laser clouds</source>
      <translation>Laser auf Wolken</translation>
    </message>
    <message>
      <source>Laser datum</source>
      <translation>Höhenbezug der Laserpunkte</translation>
    </message>
    <message>
      <source>Laser passes</source>
      <translation>Laserüberflüge</translation>
    </message>
    <message>
      <source>Laser reach</source>
      <translation>Reichweite der Laserpunkte</translation>
    </message>
    <message>
      <source>Laser segment</source>
      <translation>Lasersegment</translation>
    </message>
    <message>
      <source>Lat</source>
      <translation>Breite</translation>
    </message>
    <message>
      <source>Layer or file</source>
      <translation>Layer oder Datei</translation>
    </message>
    <message>
      <source>Layers</source>
      <translation>Layer</translation>
    </message>
    <message>
      <source>Least</source>
      <translation>Mindestens</translation>
    </message>
    <message>
      <source>Leave out</source>
      <translation>Weglassen</translation>
    </message>
    <message>
      <source>Lines</source>
      <translation>Zeilen</translation>
    </message>
    <message>
      <source>Link</source>
      <translation>Verweisen</translation>
    </message>
    <message>
      <source>Linked zoom</source>
      <translation>Gemeinsam zoomen</translation>
    </message>
    <message>
      <source>Live</source>
      <translation>Laufend</translation>
    </message>
    <message>
      <source>Load the example</source>
      <translation>Beispiel laden</translation>
    </message>
    <message>
      <source>Localize image points</source>
      <translation>Bildpunkte auf den Boden rechnen</translation>
    </message>
    <message>
      <source>Lon</source>
      <translation>Länge</translation>
    </message>
    <message>
      <source>Map of the complete area</source>
      <translation>Karte des ganzen Gebiets</translation>
    </message>
    <message>
      <source>Mask saturated</source>
      <translation>Übersättigtes maskieren</translation>
    </message>
    <message>
      <source>Match two images</source>
      <translation>Zwei Bilder zuordnen</translation>
    </message>
    <message>
      <source>Matches</source>
      <translation>Zuordnungen</translation>
    </message>
    <message>
      <source>Matching and measuring in images need {}, which this QGIS lacks.</source>
      <translation>Bildzuordnung und Messen in Bildern brauchen {}; das fehlt diesem QGIS.</translation>
    </message>
    <message>
      <source>Matching with the reference</source>
      <translation>Zuordnung zur Referenz</translation>
    </message>
    <message>
      <source>Max height</source>
      <translation>Größte Höhe</translation>
    </message>
    <message>
      <source>Max sigma</source>
      <translation>Größte Standardabweichung</translation>
    </message>
    <message>
      <source>Max slope</source>
      <translation>Größte Neigung</translation>
    </message>
    <message>
      <source>Measure targets</source>
      <translation>Zielmarken messen</translation>
    </message>
    <message>
      <source>Measure where the point is predicted, in the active view</source>
      <translation>Messen, wo der Punkt erwartet wird, in der aktiven Ansicht</translation>
    </message>
    <message>
      <source>Min correlation</source>
      <translation>Kleinste Korrelation</translation>
    </message>
    <message>
      <source>Min height</source>
      <translation>Kleinste Höhe</translation>
    </message>
    <message>
      <source>Min overlap</source>
      <translation>Kleinste Überdeckung</translation>
    </message>
    <message>
      <source>Misregistration between overlapping orthoimages, as numbers and arrows</source>
      <translation>Versatz zwischen überlappenden Orthobildern, als Zahlen und Pfeile</translation>
    </message>
    <message>
      <source>Model</source>
      <translation>Modell</translation>
    </message>
    <message>
      <source>Mosaic</source>
      <translation>Mosaik</translation>
    </message>
    <message>
      <source>Most</source>
      <translation>Höchstens</translation>
    </message>
    <message>
      <source>Most pairs</source>
      <translation>Höchstzahl der Paare</translation>
    </message>
    <message>
      <source>Ms</source>
      <translation>Multispektral</translation>
    </message>
    <message>
      <source>Name</source>
      <translation>Name</translation>
    </message>
    <message>
      <source>New block from a folder</source>
      <translation>Neuer Block aus einem Ordner</translation>
    </message>
    <message>
      <source>New block of images</source>
      <translation>Neuer Bildblock</translation>
    </message>
    <message>
      <source>New ground point at</source>
      <translation>Neuer Bodenpunkt bei</translation>
    </message>
    <message>
      <source>New…</source>
      <translation>Neu…</translation>
    </message>
    <message>
      <source>New… begins a block with images and points; Open… continues with the block.gpkg of a result or of a session.</source>
      <translation>Neu… beginnt einen Block mit Bildern und Punkten; Öffnen… setzt mit der block.gpkg eines Ergebnisses oder einer Sitzung fort.</translation>
    </message>
    <message>
      <source>Next</source>
      <translation>Nächster</translation>
    </message>
    <message>
      <source>Nodata</source>
      <translation>Kein Wert</translation>
    </message>
    <message>
      <source>Noise GCP easting and northing</source>
      <translation>Rauschen der Passpunkte, Lage</translation>
    </message>
    <message>
      <source>Noise GCP height</source>
      <translation>Rauschen der Passpunkte, Höhe</translation>
    </message>
    <message>
      <source>Noise image</source>
      <translation>Rauschen der Bildkoordinaten</translation>
    </message>
    <message>
      <source>North up</source>
      <translation>Norden oben</translation>
    </message>
    <message>
      <source>Not in view: {}; M shows it.</source>
      <translation>Nicht im Ausschnitt: {}; M zeigt es.</translation>
    </message>
    <message>
      <source>Off nadir</source>
      <translation>Nadirabweichung</translation>
    </message>
    <message>
      <source>One image with one RPC from the parts or tiles of a strip</source>
      <translation>Ein Bild mit einem RPC aus den Teilen oder Kacheln eines Streifens</translation>
    </message>
    <message>
      <source>Open block</source>
      <translation>Block öffnen</translation>
    </message>
    <message>
      <source>Open the block.gpkg of a result, or a block saved here</source>
      <translation>Die block.gpkg eines Ergebnisses öffnen, oder einen hier gespeicherten Block</translation>
    </message>
    <message>
      <source>Open…</source>
      <translation>Öffnen…</translation>
    </message>
    <message>
      <source>Options of every algorithm</source>
      <translation>Optionen aller Algorithmen</translation>
    </message>
    <message>
      <source>Ortho</source>
      <translation>Orthobild</translation>
    </message>
    <message>
      <source>Orthoimages</source>
      <translation>Orthobilder</translation>
    </message>
    <message>
      <source>Orthoimages from (refined) RPCs and a DEM, all on one map grid</source>
      <translation>Orthobilder aus (verbesserten) RPCs und einem DGM, alle in einem Kartengitter</translation>
    </message>
    <message>
      <source>Orthorectify block</source>
      <translation>Block orthorektifizieren</translation>
    </message>
    <message>
      <source>Output</source>
      <translation>Ausgabe</translation>
    </message>
    <message>
      <source>Output directory</source>
      <translation>Ausgabeordner</translation>
    </message>
    <message>
      <source>Output directory, optional</source>
      <translation>Ausgabeordner, optional</translation>
    </message>
    <message>
      <source>Output of an adjusted block</source>
      <translation>Ausgabe eines ausgeglichenen Blocks</translation>
    </message>
    <message>
      <source>Overlap</source>
      <translation>Überdeckung</translation>
    </message>
    <message>
      <source>Overwrite</source>
      <translation>Überschreiben</translation>
    </message>
    <message>
      <source>Packages for matching</source>
      <translation>Pakete für die Bildzuordnung</translation>
    </message>
    <message>
      <source>Pansharpen</source>
      <translation>Pan-Schärfung</translation>
    </message>
    <message>
      <source>Parameters</source>
      <translation>Parameter</translation>
    </message>
    <message>
      <source>Partners</source>
      <translation>Partner</translation>
    </message>
    <message>
      <source>Per cell</source>
      <translation>Je Zelle</translation>
    </message>
    <message>
      <source>Photographs of the survey, and where the point was measured; a double click opens one</source>
      <translation>Fotos der Vermessung und wo der Punkt gemessen wurde; ein Doppelklick öffnet ein Foto</translation>
    </message>
    <message>
      <source>Pixels</source>
      <translation>Pixel</translation>
    </message>
    <message>
      <source>Place</source>
      <translation>Ort</translation>
    </message>
    <message>
      <source>Places</source>
      <translation>Orte</translation>
    </message>
    <message>
      <source>Point from map</source>
      <translation>Punkt aus Karte</translation>
    </message>
    <message>
      <source>Points</source>
      <translation>Punkte</translation>
    </message>
    <message>
      <source>Previous</source>
      <translation>Voriger</translation>
    </message>
    <message>
      <source>Print layout</source>
      <translation>Drucklayout</translation>
    </message>
    <message>
      <source>Project</source>
      <translation>Projekt</translation>
    </message>
    <message>
      <source>Project file for run from the images, points and DEM of a folder</source>
      <translation>Projektdatei für „Projekt ausführen“ aus Bildern, Punkten und DGM eines Ordners</translation>
    </message>
    <message>
      <source>Project ground points</source>
      <translation>Bodenpunkte ins Bild rechnen</translation>
    </message>
    <message>
      <source>Quality</source>
      <translation>Güte</translation>
    </message>
    <message>
      <source>RPC</source>
      <translation>RPC</translation>
    </message>
    <message>
      <source>RPC information</source>
      <translation>RPC-Auskunft</translation>
    </message>
    <message>
      <source>RPCs</source>
      <translation>RPCs</translation>
    </message>
    <message>
      <source>Radius</source>
      <translation>Radius</translation>
    </message>
    <message>
      <source>Reach</source>
      <translation>Suchweite</translation>
    </message>
    <message>
      <source>Recover</source>
      <translation>Wiederherstellen</translation>
    </message>
    <message>
      <source>Recover unsaved measurements</source>
      <translation>Nicht gespeicherte Messungen wiederherstellen</translation>
    </message>
    <message>
      <source>Redo</source>
      <translation>Wiederholen</translation>
    </message>
    <message>
      <source>Reference</source>
      <translation>Referenz</translation>
    </message>
    <message>
      <source>Reference band</source>
      <translation>Referenzkanal</translation>
    </message>
    <message>
      <source>Reference datum</source>
      <translation>Höhenbezug der Referenz</translation>
    </message>
    <message>
      <source>Reference points</source>
      <translation>Referenzpunkte</translation>
    </message>
    <message>
      <source>Reference search</source>
      <translation>Suchweite in der Referenz</translation>
    </message>
    <message>
      <source>Reference sigma</source>
      <translation>Standardabweichung der Referenz</translation>
    </message>
    <message>
      <source>Refine RPC</source>
      <translation>RPC verbessern</translation>
    </message>
    <message>
      <source>Refined RPCs of a block from tie points and GCPs, with residual layers and a report</source>
      <translation>Verbesserte RPCs eines Blocks aus Verknüpfungs- und Passpunkten, mit Residuenlayern und Bericht</translation>
    </message>
    <message>
      <source>Refined RPCs of single images from ground control points</source>
      <translation>Verbesserte RPCs einzelner Bilder aus Passpunkten</translation>
    </message>
    <message>
      <source>Refined images</source>
      <translation>Bilder mit verbesserten RPCs</translation>
    </message>
    <message>
      <source>Register two images</source>
      <translation>Zwei Bilder einpassen</translation>
    </message>
    <message>
      <source>Registration of two images from matched points, by kind of point</source>
      <translation>Registrierung zweier Bilder aus zugeordneten Punkten, nach Art der Punkte</translation>
    </message>
    <message>
      <source>Reject</source>
      <translation>Ablehnen</translation>
    </message>
    <message>
      <source>Reject the match in the active view</source>
      <translation>Die Zuordnung in der aktiven Ansicht ablehnen</translation>
    </message>
    <message>
      <source>Relief</source>
      <translation>Relief</translation>
    </message>
    <message>
      <source>Remove</source>
      <translation>Punkt entfernen</translation>
    </message>
    <message>
      <source>Remove the chosen point and its measurements</source>
      <translation>Den gewählten Punkt mit seinen Messungen entfernen</translation>
    </message>
    <message>
      <source>Report</source>
      <translation>Bericht</translation>
    </message>
    <message>
      <source>Report (HTML)</source>
      <translation>Bericht (HTML)</translation>
    </message>
    <message>
      <source>Report (JSON)</source>
      <translation>Bericht (JSON)</translation>
    </message>
    <message>
      <source>Resampling</source>
      <translation>Umbildung</translation>
    </message>
    <message>
      <source>Residual CRS</source>
      <translation>KBS der Residuen</translation>
    </message>
    <message>
      <source>Residuals</source>
      <translation>Residuen</translation>
    </message>
    <message>
      <source>Resolution</source>
      <translation>Auflösung</translation>
    </message>
    <message>
      <source>Restore</source>
      <translation>Zurücksetzen</translation>
    </message>
    <message>
      <source>Result</source>
      <translation>Ergebnis</translation>
    </message>
    <message>
      <source>Robust</source>
      <translation>Robust</translation>
    </message>
    <message>
      <source>Role</source>
      <translation>Rolle</translation>
    </message>
    <message>
      <source>Run project</source>
      <translation>Projekt ausführen</translation>
    </message>
    <message>
      <source>STAC items</source>
      <translation>STAC-Einträge</translation>
    </message>
    <message>
      <source>Save</source>
      <translation>Speichern</translation>
    </message>
    <message>
      <source>Save as…</source>
      <translation>Speichern als…</translation>
    </message>
    <message>
      <source>Save block</source>
      <translation>Block speichern</translation>
    </message>
    <message>
      <source>Save points and measurements in the block's GeoPackage</source>
      <translation>Punkte und Messungen im GeoPackage des Blocks speichern</translation>
    </message>
    <message>
      <source>Save the measurements of this block first?</source>
      <translation>Die Messungen dieses Blocks zuerst speichern?</translation>
    </message>
    <message>
      <source>Save under another name</source>
      <translation>Unter anderem Namen speichern</translation>
    </message>
    <message>
      <source>Scale</source>
      <translation>Maßstab</translation>
    </message>
    <message>
      <source>Scheduler</source>
      <translation>Scheduler</translation>
    </message>
    <message>
      <source>Scheduler ca</source>
      <translation>Scheduler-Zertifizierungsstelle</translation>
    </message>
    <message>
      <source>Scheduler certificate</source>
      <translation>Scheduler-Zertifikat</translation>
    </message>
    <message>
      <source>Scheduler key</source>
      <translation>Scheduler-Schlüssel</translation>
    </message>
    <message>
      <source>Search</source>
      <translation>Suchweite</translation>
    </message>
    <message>
      <source>Search for the point by matching in all other images that contain it</source>
      <translation>Den Punkt durch Bildzuordnung in allen anderen Bildern suchen, die ihn enthalten</translation>
    </message>
    <message>
      <source>Search for tie points</source>
      <translation>Suche nach Verknüpfungspunkten</translation>
    </message>
    <message>
      <source>Search margin</source>
      <translation>Suchrand</translation>
    </message>
    <message>
      <source>Searching for {} by its chips.</source>
      <translation>{} wird anhand seiner Bildausschnitte gesucht.</translation>
    </message>
    <message>
      <source>Second</source>
      <translation>Zweites</translation>
    </message>
    <message>
      <source>Seed</source>
      <translation>Startwert des Zufalls</translation>
    </message>
    <message>
      <source>Selected features only</source>
      <translation>Nur gewählte Objekte</translation>
    </message>
    <message>
      <source>Sensor</source>
      <translation>Sensor</translation>
    </message>
    <message>
      <source>Sensor images</source>
      <translation>Bilder eines Sensors</translation>
    </message>
    <message>
      <source>Share</source>
      <translation>Anteil</translation>
    </message>
    <message>
      <source>Shared images</source>
      <translation>Bilder eines Streifens</translation>
    </message>
    <message>
      <source>Show me the point</source>
      <translation>Punkt zeigen</translation>
    </message>
    <message>
      <source>Show the arrows</source>
      <translation>Pfeile zeigen</translation>
    </message>
    <message>
      <source>Show the command</source>
      <translation>Befehl zeigen</translation>
    </message>
    <message>
      <source>Show the residuals of one image, or those that a reason of the verdict is about</source>
      <translation>Die Residuen eines Bildes zeigen, oder die, um die es in einem Grund des Urteils geht</translation>
    </message>
    <message>
      <source>Show the whole image; choosing the point again comes back</source>
      <translation>Das ganze Bild zeigen; den Punkt erneut wählen führt zurück</translation>
    </message>
    <message>
      <source>Sigma DEM</source>
      <translation>Standardabweichung des DGM</translation>
    </message>
    <message>
      <source>Sigma GCP easting and northing</source>
      <translation>Standardabweichung der Passpunkte, Lage</translation>
    </message>
    <message>
      <source>Sigma GCP height</source>
      <translation>Standardabweichung der Passpunkte, Höhe</translation>
    </message>
    <message>
      <source>Sigma drift</source>
      <translation>Standardabweichung der Drift</translation>
    </message>
    <message>
      <source>Sigma east, north (m)</source>
      <translation>Standardabweichung Ost, Nord (m)</translation>
    </message>
    <message>
      <source>Sigma height (m)</source>
      <translation>Standardabweichung Höhe (m)</translation>
    </message>
    <message>
      <source>Sigma image</source>
      <translation>Standardabweichung der Bildkoordinaten</translation>
    </message>
    <message>
      <source>Sigma laser</source>
      <translation>Standardabweichung der Laserpunkte</translation>
    </message>
    <message>
      <source>Sigma shift</source>
      <translation>Standardabweichung der Verschiebung</translation>
    </message>
    <message>
      <source>Sigma surface</source>
      <translation>Standardabweichung der Oberfläche</translation>
    </message>
    <message>
      <source>Simulate block</source>
      <translation>Block simulieren</translation>
    </message>
    <message>
      <source>Size</source>
      <translation>Größe</translation>
    </message>
    <message>
      <source>Smallest</source>
      <translation>Kleinster</translation>
    </message>
    <message>
      <source>Standard deviations for points and measurements whose file gives none</source>
      <translation>Standardabweichungen für Punkte und Messungen, deren Datei keine nennt</translation>
    </message>
    <message>
      <source>Steps</source>
      <translation>Schritte</translation>
    </message>
    <message>
      <source>Stop the adjustment</source>
      <translation>Die Ausgleichung anhalten</translation>
    </message>
    <message>
      <source>Strict datum</source>
      <translation>Datum ohne Ersatz</translation>
    </message>
    <message>
      <source>Strips</source>
      <translation>Streifen</translation>
    </message>
    <message>
      <source>Sub-pixel centre or corner near given positions, or from edge points measured by hand</source>
      <translation>Mittelpunkt oder Ecke auf Bruchteile eines Pixels nahe gegebenen Positionen oder aus von Hand gemessenen Kantenpunkten</translation>
    </message>
    <message>
      <source>Sun azimuth</source>
      <translation>Sonnenazimut</translation>
    </message>
    <message>
      <source>Super share</source>
      <translation>Anteil der Superpunkte</translation>
    </message>
    <message>
      <source>Super threshold</source>
      <translation>Schwelle der Superpunkte</translation>
    </message>
    <message>
      <source>Surface</source>
      <translation>Oberfläche</translation>
    </message>
    <message>
      <source>Surface datum</source>
      <translation>Höhenbezug der Oberfläche</translation>
    </message>
    <message>
      <source>Surface kind</source>
      <translation>Art der Oberfläche</translation>
    </message>
    <message>
      <source>Surface model</source>
      <translation>Oberflächenmodell</translation>
    </message>
    <message>
      <source>Surface search</source>
      <translation>Suchbereich der Oberfläche</translation>
    </message>
    <message>
      <source>Take prediction</source>
      <translation>Erwartung nehmen</translation>
    </message>
    <message>
      <source>Terrain points</source>
      <translation>Geländepunkte</translation>
    </message>
    <message>
      <source>Test sigmas</source>
      <translation>Standardabweichungen prüfen</translation>
    </message>
    <message>
      <source>Texts on the cover of the report</source>
      <translation>Texte auf dem Deckblatt des Berichts</translation>
    </message>
    <message>
      <source>The band that is shown; targets are measured on the first</source>
      <translation>Der gezeigte Kanal; Zielmarken werden im ersten gemessen</translation>
    </message>
    <message>
      <source>The command for the Python of this QGIS is</source>
      <translation>Der Befehl für das Python dieses QGIS ist</translation>
    </message>
    <message>
      <source>The measurements of the previous block are still here; they are not saved yet</source>
      <translation>Die Messungen des vorigen Blocks sind noch da; sie sind noch nicht gespeichert</translation>
    </message>
    <message>
      <source>The next point that is not measured on all its images</source>
      <translation>Der nächste Punkt, der nicht in allen Bildern gemessen ist, die ihn zeigen</translation>
    </message>
    <message>
      <source>The previous point that is not measured on all its images</source>
      <translation>Der vorige Punkt, der nicht in allen Bildern gemessen ist, die ihn zeigen</translation>
    </message>
    <message>
      <source>The wheel zooms all images</source>
      <translation>Das Mausrad zoomt alle Bilder</translation>
    </message>
    <message>
      <source>There are no unsaved measurements</source>
      <translation>Es gibt keine ungespeicherten Messungen</translation>
    </message>
    <message>
      <source>This was the last step. Use New… in the panel for your own block, and the toolbox for all other algorithms.</source>
      <translation>Das war der letzte Schritt. Neu… im Bedienfeld beginnt einen eigenen Block; alle anderen Algorithmen sind in der Werkzeugkiste.</translation>
    </message>
    <message>
      <source>Threads</source>
      <translation>Threads</translation>
    </message>
    <message>
      <source>Threads or workers for tie points and orthoimages</source>
      <translation>Wer Verknüpfungspunkte sucht oder Orthobilder macht</translation>
    </message>
    <message>
      <source>Threshold</source>
      <translation>Schwelle</translation>
    </message>
    <message>
      <source>Tie point</source>
      <translation>Verknüpfungspunkt</translation>
    </message>
    <message>
      <source>Tie points</source>
      <translation>Verknüpfungspunkte</translation>
    </message>
    <message>
      <source>Ties</source>
      <translation>Verknüpfungspunkte</translation>
    </message>
    <message>
      <source>Tile</source>
      <translation>Kachel</translation>
    </message>
    <message>
      <source>Title</source>
      <translation>Titel</translation>
    </message>
    <message>
      <source>To</source>
      <translation>Ziel</translation>
    </message>
    <message>
      <source>Tracks</source>
      <translation>Mehrfachpunkte</translation>
    </message>
    <message>
      <source>Transfer</source>
      <translation>Übertragen</translation>
    </message>
    <message>
      <source>Triangulate block</source>
      <translation>Block triangulieren</translation>
    </message>
    <message>
      <source>Triangulate to orthoimages</source>
      <translation>Von der Triangulation zu Orthobildern</translation>
    </message>
    <message>
      <source>Triangulation</source>
      <translation>Triangulation</translation>
    </message>
    <message>
      <source>Turn the images so that north is on top</source>
      <translation>Die Bilder so drehen, dass Norden oben ist</translation>
    </message>
    <message>
      <source>Undo</source>
      <translation>Rückgängig</translation>
    </message>
    <message>
      <source>Used points</source>
      <translation>Verwendete Punkte</translation>
    </message>
    <message>
      <source>Variance components</source>
      <translation>Varianzkomponenten</translation>
    </message>
    <message>
      <source>Variance groups</source>
      <translation>Varianzgruppen</translation>
    </message>
    <message>
      <source>Vendor attitude</source>
      <translation>Fehler der gelieferten Lage</translation>
    </message>
    <message>
      <source>Vendor attitude drift</source>
      <translation>Drift der gelieferten Lage</translation>
    </message>
    <message>
      <source>Vendor error</source>
      <translation>Fehler des Anbieters</translation>
    </message>
    <message>
      <source>Vendor position</source>
      <translation>Fehler der gelieferten Position</translation>
    </message>
    <message>
      <source>Vendor position drift</source>
      <translation>Drift der gelieferten Position</translation>
    </message>
    <message>
      <source>Verdict</source>
      <translation>Urteil</translation>
    </message>
    <message>
      <source>Verdict: ok, doubtful or unusable</source>
      <translation>Urteil: gut, zweifelhaft oder unbrauchbar</translation>
    </message>
    <message>
      <source>Vertical</source>
      <translation>Höhenbezug</translation>
    </message>
    <message>
      <source>Visibility</source>
      <translation>Sichtbarkeit</translation>
    </message>
    <message>
      <source>What a free DEM of a scene is like</source>
      <translation>Wie ein freies DGM einer Szene ist</translation>
    </message>
    <message>
      <source>What a free orthoimage of a scene is like</source>
      <translation>Wie ein freies Orthobild einer Szene ist</translation>
    </message>
    <message>
      <source>What a scene should be like</source>
      <translation>Wie eine Szene sein soll</translation>
    </message>
    <message>
      <source>What is clicked: a round or closed object, two straight edges, or only this position</source>
      <translation>Was angeklickt wird: ein rundes oder geschlossenes Objekt, zwei gerade Kanten oder nur diese Position</translation>
    </message>
    <message>
      <source>What to look for, and how much of it</source>
      <translation>Wonach gesucht wird, und wie viel davon</translation>
    </message>
    <message>
      <source>Where a target may be, and how large</source>
      <translation>Wo ein Ziel sein darf, und wie groß</translation>
    </message>
    <message>
      <source>Which laser points a scene gets</source>
      <translation>Welche Laserpunkte eine Szene bekommt</translation>
    </message>
    <message>
      <source>Which sensor looks from where</source>
      <translation>Welcher Sensor von wo aus aufnimmt</translation>
    </message>
    <message>
      <source>Whole</source>
      <translation>Ganz</translation>
    </message>
    <message>
      <source>Window</source>
      <translation>Fenster</translation>
    </message>
    <message>
      <source>Window 1</source>
      <translation>Fenster 1</translation>
    </message>
    <message>
      <source>Window 2</source>
      <translation>Fenster 2</translation>
    </message>
    <message>
      <source>Window, overview or resampled copy of images, with the exact RPC</source>
      <translation>Ausschnitt, Übersicht oder umgerechnete Kopie von Bildern, mit dem exakten RPC</translation>
    </message>
    <message>
      <source>Work directory</source>
      <translation>Arbeitsordner</translation>
    </message>
    <message>
      <source>Write</source>
      <translation>Schreiben</translation>
    </message>
    <message>
      <source>Write RPC</source>
      <translation>RPC schreiben</translation>
    </message>
    <message>
      <source>Write an RPC into a GeoTIFF, a sidecar or a VRT; `restore` restores the original</source>
      <translation>Einen RPC in ein GeoTIFF, eine Begleitdatei oder ein VRT schreiben; `restore` stellt das Original wieder her</translation>
    </message>
    <message>
      <source>Wrong height size</source>
      <translation>Größe falscher Höhen</translation>
    </message>
    <message>
      <source>Wrong heights</source>
      <translation>Falsche Höhen</translation>
    </message>
    <message>
      <source>Y accepts the match in the framed view, Shift+Y all matches, X rejects it.</source>
      <translation>Y nimmt die Zuordnung in der umrahmten Ansicht an, Umschalt+Y alle, X lehnt sie ab.</translation>
    </message>
    <message>
      <source>a block that was never saved</source>
      <translation>ein nie gespeicherter Block</translation>
    </message>
    <message>
      <source>a box:</source>
      <translation>ein Rechteck:</translation>
    </message>
    <message>
      <source>adjusting …</source>
      <translation>gleiche aus …</translation>
    </message>
    <message>
      <source>as clicked</source>
      <translation>wie geklickt</translation>
    </message>
    <message>
      <source>band</source>
      <translation>Kanal</translation>
    </message>
    <message>
      <source>cancelled</source>
      <translation>abgebrochen</translation>
    </message>
    <message>
      <source>dE m</source>
      <translation>dE m</translation>
    </message>
    <message>
      <source>dH m</source>
      <translation>dH m</translation>
    </message>
    <message>
      <source>dN m</source>
      <translation>dN m</translation>
    </message>
    <message>
      <source>default</source>
      <translation>Vorgabe</translation>
    </message>
    <message>
      <source>dl px</source>
      <translation>dz px</translation>
    </message>
    <message>
      <source>doubtful</source>
      <translation>zweifelhaft</translation>
    </message>
    <message>
      <source>ds px</source>
      <translation>ds px</translation>
    </message>
    <message>
      <source>found, correlation {:.2f}</source>
      <translation>gefunden, Korrelation {:.2f}</translation>
    </message>
    <message>
      <source>from the map, a layer, or drawn</source>
      <translation>aus der Karte, von einem Layer oder gezeichnet</translation>
    </message>
    <message>
      <source>image</source>
      <translation>Bild</translation>
    </message>
    <message>
      <source>images</source>
      <translation>Bilder</translation>
    </message>
    <message>
      <source>installing packages …</source>
      <translation>Pakete werden installiert …</translation>
    </message>
    <message>
      <source>kind</source>
      <translation>Art</translation>
    </message>
    <message>
      <source>line</source>
      <translation>Zeile</translation>
    </message>
    <message>
      <source>making the images …</source>
      <translation>die Bilder werden erzeugt …</translation>
    </message>
    <message>
      <source>measure more GCPs, or a check point</source>
      <translation>messen Sie mehr Passpunkte oder einen Kontrollpunkt</translation>
    </message>
    <message>
      <source>no DEM: as typed</source>
      <translation>kein DGM: wie eingegeben</translation>
    </message>
    <message>
      <source>no GCP: no check possible</source>
      <translation>kein Passpunkt: keine Kontrolle möglich</translation>
    </message>
    <message>
      <source>no other image contains this point</source>
      <translation>kein anderes Bild enthält diesen Punkt</translation>
    </message>
    <message>
      <source>no pixels</source>
      <translation>keine Pixel</translation>
    </message>
    <message>
      <source>normalised</source>
      <translation>normiert</translation>
    </message>
    <message>
      <source>nothing</source>
      <translation>nichts</translation>
    </message>
    <message>
      <source>ok</source>
      <translation>gut</translation>
    </message>
    <message>
      <source>point</source>
      <translation>Punkt</translation>
    </message>
    <message>
      <source>predicted at sample {:.1f}, line {:.1f}</source>
      <translation>erwartet in Spalte {:.1f}, Zeile {:.1f}</translation>
    </message>
    <message>
      <source>redone</source>
      <translation>wiederholt</translation>
    </message>
    <message>
      <source>role</source>
      <translation>Rolle</translation>
    </message>
    <message>
      <source>sample</source>
      <translation>Spalte</translation>
    </message>
    <message>
      <source>saved: {}</source>
      <translation>gespeichert: {}</translation>
    </message>
    <message>
      <source>saved: {}; {} chips added to {}</source>
      <translation>gespeichert: {}; {} Bildausschnitte neu in {}</translation>
    </message>
    <message>
      <source>sigma h m</source>
      <translation>sigma h m</translation>
    </message>
    <message>
      <source>sigma px</source>
      <translation>sigma px</translation>
    </message>
    <message>
      <source>sigma xy m</source>
      <translation>sigma xy m</translation>
    </message>
    <message>
      <source>sigma {:.2f} px</source>
      <translation>Standardabweichung {:.2f} px</translation>
    </message>
    <message>
      <source>tie point on {}: {}</source>
      <translation>Verknüpfungspunkt in {}: {}</translation>
    </message>
    <message>
      <source>undone</source>
      <translation>rückgängig gemacht</translation>
    </message>
    <message>
      <source>unusable</source>
      <translation>unbrauchbar</translation>
    </message>
    <message>
      <source>warning</source>
      <translation>Warnung</translation>
    </message>
    <message>
      <source>{} GCPs: no check possible</source>
      <translation>{} Passpunkte: keine Kontrolle möglich</translation>
    </message>
    <message>
      <source>{} images chosen</source>
      <translation>{} Bilder gewählt</translation>
    </message>
    <message>
      <source>{} is not a number</source>
      <translation>{} ist keine Zahl</translation>
    </message>
    <message>
      <source>{} measured on {}</source>
      <translation>{} gemessen in {}</translation>
    </message>
    <message>
      <source>{} measurements are back; save them</source>
      <translation>{} Messungen sind wieder da; jetzt speichern</translation>
    </message>
    <message>
      <source>{} measurements of {} were not saved: {}</source>
      <translation>{} Messungen von {} waren nicht gespeichert: {}</translation>
    </message>
    <message>
      <source>{} on {}: match rejected; click on the point, or leave it out</source>
      <translation>{} in {}: Zuordnung abgelehnt; den Punkt anklicken oder weglassen</translation>
    </message>
    <message>
      <source>{} on {}: {}</source>
      <translation>{} in {}: {}</translation>
    </message>
    <message>
      <source>{} points, {} images: {}</source>
      <translation>{} Punkte, {} Bilder: {}</translation>
    </message>
    <message>
      <source>{}: {} chips; {} of its GCPs are new in the list. Saving the block adds chips.</source>
      <translation>{}: {} Bildausschnitte; {} der Passpunkte sind neu in der Liste. Beim Speichern des Blocks kommen Bildausschnitte hinzu.</translation>
    </message>
  </context>
</TS>
