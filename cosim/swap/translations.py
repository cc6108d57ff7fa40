"""Words of other languages, and units at the end of names: the parts of names besides English words."""

from __future__ import annotations

import unicodedata
from collections.abc import Mapping

_GERMAN = """
geschwindigkeit=velocity gier=yaw lenk=steering lenkung=steering einschlag=steering lenkrad=hand kurs=heading
fahrtrichtung=heading ausrichtung=orientation orientierung=orientation winkel=angle lage=pose ort=position weg=position
radstand=wheelbase achse=axle achsen=axles achs=axle achsabstand=axle-distance abstand=distance laenge=length
breite=width spurweite=track-width spur=track halb=half halbe=half drehmoment=torque momente=torque
antrieb=drive antriebs=drive fahr=drive kraft=force reibung=friction bremse=brake brems=brake masse=mass
traegheit=inertia fahrzeug=vehicle wagen=vehicle roboter=robot anhaenger=trailer auflieger=trailer zugmaschine=tractor
zugfahrzeug=tractor schlepper=tractor sattelzug=tractor deichsel=drawbar kupplung=coupling rad=wheel raeder=wheels
rechts=right rechte=right rechter=right rechtes=right links=left linke=left linker=left linkes=left vorn=front
vorne=front vorder=front hinten=rear hinter=rear laengs=longitudinal quer=lateral seiten=lateral
beschleunigung=acceleration anfang=initial anfangs=initial beginn=initial soll=desired ziel=target ist=actual
messwert=measured fehler=error zustand=state eingang=input ausgang=output neigung=pitch wank=roll nick=pitch
"""
_FRENCH = """
vitesse=velocity lacet=yaw braquage=steering volant=hand empattement=wheelbase couple=torque
moteur=motor entrainement=drive roue=wheel remorque=trailer tracteur=tractor rayon=radius attelage=hitch
longueur=length largeur=width droite=right droit=right gauche=left voie=track demi=half consigne=setpoint etat=state
entree=input sortie=output initiale=initial frein=brake arriere=rear avant=front vehicule=vehicle essieu=axle
essieux=axles roulis=roll tangage=pitch masse=mass
"""
_SPANISH_AND_ITALIAN = """
velocidad=velocity rumbo=heading guinada=yaw direccion=steering viraje=steering volante=hand batalla=wheelbase
traccion=traction motriz=drive rueda=wheel remolque=trailer radio=radius enganche=hitch longitud=length ancho=width
distancia=distance ejes=axles eje=axle derecha=right derecho=right izquierda=left izquierdo=left medio=half media=half
posicion=position angulo=angle orientacion=orientation consigna=setpoint estado=state entrada=input salida=output
inicial=initial vehiculo=vehicle masa=mass fuerza=force freno=brake
velocita=velocity imbardata=yaw sterzo=steering sterzata=steering passo=wheelbase coppia=torque ruota=wheel
rimorchio=trailer raggio=radius destra=right sinistra=left posizione=position angolo=angle
"""
TRANSLATED: Mapping[str, tuple[str, ...]] = {
    word: tuple(english.split("-"))
    for text in (_GERMAN, _FRENCH, _SPANISH_AND_ITALIAN)
    for word, _, english in (pair.partition("=") for pair in text.split())
}
"""English words, as in the clues of `cosim.swap.naming`, for words of other languages without accents."""

_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue"})

_UNITS: Mapping[str, str] = {
    "deg": "deg",
    "degree": "deg",
    "degrees": "deg",
    "grad": "deg",
    "rad": "rad",
    "mrad": "mrad",
    "m": "m",
    "mm": "mm",
    "cm": "cm",
    "km": "km",
    "kmh": "km/h",
    "kph": "km/h",
    "km h": "km/h",
    "km per h": "km/h",
    "mps": "m/s",
    "ms": "m/s",
    "m s": "m/s",
    "m per s": "m/s",
    "mm s": "mm/s",
    "degs": "deg/s",
    "deg s": "deg/s",
    "deg per s": "deg/s",
    "dps": "deg/s",
    "rads": "rad/s",
    "radps": "rad/s",
    "rad s": "rad/s",
    "rad per s": "rad/s",
    "nm": "N.m",
    "n m": "N.m",
    "knm": "kN.m",
    "nmm": "N.mm",
}
_LONGEST = max(len(words.split()) for words in _UNITS)
_LAST = frozenset(words.split()[-1] for words in _UNITS)


def plain(name: str) -> str:
    """Return a name without accents, and with umlauts as German writes them in ASCII."""
    if name.isascii():
        return name
    decomposed = unicodedata.normalize("NFD", unicodedata.normalize("NFC", name).translate(_UMLAUTS))
    return "".join(letter for letter in decomposed if not unicodedata.combining(letter))


def unit_at_the_end(words: tuple[str, ...]) -> tuple[int, str]:
    """Return how many words at the end of a name are a unit, as in ``speed_km_h``, and which; 0 if none are.

    A name that is nothing but a unit has none.
    """
    if words and words[-1] not in _LAST:
        return 0, ""
    for count in range(min(_LONGEST, len(words) - 1), 0, -1):
        if unit := _UNITS.get(" ".join(words[-count:])):
            return count, unit
    return 0, ""
