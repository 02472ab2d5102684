"""Files: design tables, images, WCS, SQLite, atomic writes, shipped data.

shipped       Name of shipped data -> its path on this computer.
reading       Path of a file from anybody -> its bytes, where it is regular and not too large.
saving        Files that are written whole or not at all.
claim         A folder or a file -> claimed for this process; others are told by which.
sqlite        SQLite file of one kind -> its tables, open for one process at a time; errors as
              sentences.
tables        Frozen dataclasses to tables of TOML and back, units in strings, each error with its
              place.
layers        A TOML file, the files below it, and single values -> one table, and the file of each
              value.
checked_fits  FITS file -> its parts with verified checksums, or a sentence that says what is wrong.
wcs           Camera and attitude as a FITS world coordinate system, and back to pixels by any
              reader.
picture_size  Bytes of a PNG, JPEG or TIFF file -> its size, without decoding it.
recordings    SER, raw and video files -> images; Bayer mosaics -> images of one colour or of all.
images        Image files to frames, and frames to FITS with their WCS and their truth.
interchange   Tables of results -> pandas, xarray and astropy, with the units of their columns;
              rows of texts in columns.
solution      A solved image -> FITS files as astrometry.net writes them, and values by the names
              of tetra3.
frame_files   Frames, their times and attitudes -> FITS, PNG, SER, raw or video files, and a table.
"""

from startrack.io.checked_fits import open_checked, require_fits, save_checked
from startrack.io.claim import claimed_folder
from startrack.io.frame_files import FORMATS, FrameFiles
from startrack.io.images import read_image, write_fits
from startrack.io.interchange import aligned, to_pandas, to_qtable, to_xarray
from startrack.io.layers import Layers, read_layers
from startrack.io.reading import read_bytes, regular_file, unpacked
from startrack.io.recordings import COLOURS, PATTERNS, Layout
from startrack.io.saving import save_csv, save_figure, save_json, save_netcdf, save_text, whole
from startrack.io.shipped import shipped
from startrack.io.solution import tetra3_values, write_solution
from startrack.io.sqlite import Database, Execute, FileKind
from startrack.io.tables import (
    LARGEST_INTEGER,
    current_key,
    from_table,
    read_table,
    to_table,
    written,
)
from startrack.io.wcs import camera_to_wcs, celestial, celestials, pointing, wcs_header

# Public; the other imports serve other rooms.
__all__ = ["shipped"]
