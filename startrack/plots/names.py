"""Proper names of the brightest stars, by their Hipparcos numbers.

Those of the stars that the shipped catalogue has from Hipparcos, because they are too bright for
Gaia. Source: Catalog of Star Names of the IAU's Working Group on Star Names (2022-04-04).
"""

from __future__ import annotations

PROPER_NAMES = {
    677: "Alpheratz", 3419: "Diphda", 5447: "Mirach", 7588: "Achernar", 8903: "Sheratan",
    9640: "Almach", 9884: "Hamal", 11767: "Polaris", 14135: "Menkar", 14576: "Algol",
    15863: "Mirfak", 21421: "Aldebaran", 24436: "Rigel", 24608: "Capella", 25336: "Bellatrix",
    25428: "Elnath", 26311: "Alnilam", 26727: "Alnitak", 27989: "Betelgeuse", 28360: "Menkalinan",
    28380: "Mahasim", 30324: "Mirzam", 30438: "Canopus", 31681: "Alhena", 32349: "Sirius",
    33579: "Adhara", 34444: "Wezen", 36850: "Castor", 37279: "Procyon", 37826: "Pollux",
    41037: "Avior", 42913: "Alsephina", 44816: "Suhail", 45238: "Miaplacidus", 46390: "Alphard",
    49669: "Regulus", 50583: "Algieba", 54061: "Dubhe", 57632: "Denebola", 59803: "Gienah",
    60718: "Acrux", 61084: "Gacrux", 62434: "Mimosa", 65474: "Spica", 68702: "Hadar",
    68933: "Menkent", 69673: "Arcturus", 71681: "Toliman", 71683: "Rigil Kentaurus",
    72607: "Kochab", 78401: "Dschubba", 80763: "Antares", 82273: "Atria", 84345: "Rasalgethi",
    85696: "Lesath", 85927: "Shaula", 86228: "Sargas", 87833: "Eltanin", 90185: "Kaus Australis",
    91262: "Vega", 92855: "Nunki", 97649: "Altair", 100751: "Peacock", 102098: "Deneb",
    107315: "Enif", 112122: "Tiaki", 113368: "Fomalhaut", 113881: "Scheat",
}  # fmt: skip
