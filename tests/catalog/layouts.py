"""Real stars written in the layouts of the catalogues, for the readers' tests.

Values: Hipparcos (ESA 1997), van Leeuwen (2007), Tycho-2 (Hog et al. 2000), Bright Star Catalogue
(Hoffleit & Warren 1991), HYG 3, Gaia DR3. Fields that no reader looks at are left blank.
"""

import numpy as np


def bars(count: int, fields: dict[int, str]) -> str:
    return "|".join(fields.get(i, " ") for i in range(count)) + "\n"


def fixed(width: int, fields: dict[int, str]) -> str:
    """A line from fields by their first byte, counted from 1."""
    line = np.full(width, " ")
    for first, text in fields.items():
        line[first - 1 : first - 1 + len(text)] = list(text)
    return "".join(line) + "\n"


def hip_main(hip, hms, dms, v, ra, dec, plx, pm_ra, pm_dec, v_i, hp) -> str:
    return bars(
        78,
        {
            0: "H",
            1: f"{hip:12d}",
            3: hms,
            4: dms,
            5: f"{v:5.2f}",
            8: ra,
            9: dec,
            11: plx,
            12: pm_ra,
            13: pm_dec,
            40: v_i,
            44: hp,
        },
    )


HIP_MAIN = (
    hip_main(
        32349,
        "06 45 09.25",
        "-16 42 47.3",
        -1.44,
        "101.28854105",
        "-16.71314306",
        " 379.21",
        " -546.01",
        "-1223.08",
        "-0.02",
        "-1.0876",
    )
    + hip_main(
        91262,
        "18 36 56.19",
        "+38 46 58.8",
        0.03,
        "279.23410832",
        "+38.78299311",
        " 128.93",
        "  201.02",
        "  287.46",
        "-0.01",
        " 0.0868",
    )
    + hip_main(
        11767,
        "02 31 47.08",
        "+89 15 50.9",
        1.97,
        "037.94614689",
        "+89.26413805",
        "   7.56",
        "   44.22",
        "  -11.74",
        " 0.70",
        " 2.1077",
    )
)


def hip2(hip, ra_deg, dec_deg, plx, pm_ra, pm_dec, hp, v_i="") -> str:
    return fixed(
        276,
        {
            1: f"{hip:6d}",
            16: f"{np.deg2rad(ra_deg):13.10f}",
            30: f"{np.deg2rad(dec_deg):13.10f}",
            44: f"{plx:7.2f}",
            52: f"{pm_ra:8.2f}",
            61: f"{pm_dec:8.2f}",
            130: f"{hp:7.4f}",
            166: f"{v_i:>6}",
            270: "   0.00",
        },
    )


# The first line of the catalogue, a star of V = 12.1, and HD 209458.
TYCHO2 = (
    "0001 00008 1| |  2.31750494|  2.23184345|  -16.3|   -9.0| 68| 73| 1.7| 1.8|1958.89|1951.94|"
    " 4|1.0|1.0|0.9|1.0|12.146|0.158|12.146|0.223|999| |         |  2.31754222|  2.23186444|1.67|"
    "1.54| 88.0|100.8| |-0.2\n"
) + bars(
    32,
    {
        0: "1688 01821 1", 2: "330.79488630", 3: " 18.88431920", 4: "   29.6", 5: "  -17.9",
        17: " 8.323", 19: " 7.702", 23: "108859   ", 24: "330.79479", 25: " 18.88436",
    },
)  # fmt: skip


def bsc(hr, name, ra, dec, v, b_v, pm_ra, pm_dec, parallax) -> str:
    return fixed(
        197,
        {
            1: f"{hr:4d}",
            5: name,
            76: ra,
            84: dec,
            103: f"{v:5.2f}",
            110: f"{b_v:5.2f}",
            149: f"{pm_ra:+6.3f}",
            155: f"{pm_dec:+6.3f}",
            162: f"{parallax:+5.3f}"[:5],
        },
    )


BSC = (
    fixed(197, {1: "  92", 5: "NOVA 1572", 130: " "})
    + bsc(2491, "  9Alp CMa", "064508.9", "-164258", -1.46, 0.00, -0.553, -1.205, 0.375)
    + bsc(7001, "  3Alp Lyr", "183656.3", "+384701", 0.03, 0.00, 0.202, 0.287, 0.123)
    + bsc(8086, " 61    Cyg", "210655.3", "+384431", 6.03, 1.37, 4.106, 3.144, 0.286)
)

HYG = (
    '"id","hip","hd","hr","gl","bf","proper","ra","dec","dist","pmra","pmdec","rv","mag","absmag",'
    '"spect","ci"\n'
    '0,,,,,,"Sol",0.000000,0.000000,0.0000,0.00,0.00,0.0,-26.700,4.850,"G2V",0.656\n'
    '32263,32349,48915,2491,"Gl 244A","9Alp CMa","Sirius",6.752481,-16.716116,2.6371,-546.01,'
    '-1223.08,-9.4,-1.440,1.454,"A0m...",0.009\n'
    '90979,91262,172167,7001,"Gl 721","3Alp Lyr","Vega",18.615649,38.783692,7.6787,201.02,287.46,'
    '-12.1,0.030,0.604,"A0Vvar",-0.001\n'
    '118441,,,,"Gl 551x","","",14.495263,-62.679485,100000.0,,,,11.050,15.0,"M5Ve",1.807\n'
)

# 61 Cygni B, Gaia DR3; and a faint made-up neighbour without motion.
GAIA = (
    "source_id,ra,dec,parallax,pmra,pmdec,phot_g_mean_mag,bp_rp\n"
    "1872046574983497216,316.753662752556,38.75607277205679,286.0053518616485,4105.976428209489,"
    "3155.9416398273515,5.4506445,1.715341\n"
    "1872046574983497999,316.76,38.75,,null,,12.5,\n"
)
