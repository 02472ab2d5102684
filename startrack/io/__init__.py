"""Files: design tables, images, WCS, SQLite, atomic writes, shipped data.

reading       Path of an untrusted file -> its bytes, if it is regular, not too large, and of the
              claimed kind; name of shipped data -> its path.
cache         Function and its arguments -> its result, from a file if a former command has computed
              it.
saving        Files that are written completely or not at all; folders that one process at a time
              writes to, with a message to other processes.
sqlite        SQLite file of one kind -> its tables, open for one process at a time; errors as
              sentences.
text          Bytes of a text file from any program -> text; CSV of any locale -> columns.
toml_file     Path of a TOML file -> its table.
tables        Frozen dataclasses to tables of TOML and back, units in strings, each error with its
              place.
layers        A file, its base files, and single values -> one table, and the file of each value.
wcs           Camera and attitude as a FITS world coordinate system, and back to pixels by any
              reader; a solved image as FITS files of astrometry.net, and by the names of tetra3.
recordings    SER, raw and video files -> images; Bayer mosaics -> images of one colour or of all.
tiff          Bytes of a TIFF -> its pixels.
pictures      Bytes of a PNG, JPEG, BMP or HEIC -> its pixels.
fits_image    Bytes of a FITS file -> its image, exposure, gain, offset and time.
images        Image files to frames, and frames to FITS with their WCS and their truth.
interchange   Tables of results -> pandas, xarray and astropy, with the units of their columns;
              rows of texts in columns.
frame_files   Frames, their times and attitudes -> FITS, PNG, SER, raw or video files, and a table.
"""

from startrack.io.cache import cache_folder, from_cache, recalled
from startrack.io.frame_files import FrameFiles
from startrack.io.images import field_hint, read_frames, read_image, rows_upwards, write_fits
from startrack.io.interchange import aligned, to_pandas, to_qtable, to_xarray
from startrack.io.layers import LayerRules, Layers, Renewed, keys_of_layers, read_layers
from startrack.io.reading import (
    checked_arrays,
    name_from,
    open_checked,
    path_from,
    read_bytes,
    regular_file,
    require_fits,
    shipped,
    unpacked,
)
from startrack.io.recordings import YEAR_2000, Layout, frames_in
from startrack.io.saving import (
    claimed_folder,
    finite,
    save_arrays,
    save_csv,
    save_figure,
    save_json,
    save_netcdf,
    save_text,
    save_toml,
    whole,
)
from startrack.io.sqlite import Database, Execute, FileKind
from startrack.io.tables import (
    LARGEST_INTEGER,
    current_key,
    from_table,
    meant_key,
    refuse_unknown,
    to_table,
    written,
)
from startrack.io.text import (
    TEXT_NEEDED,
    content,
    csv_table,
    decoded,
    first_line,
    in_lower_case,
    with_points,
)
from startrack.io.toml_file import read_table
from startrack.io.wcs import (
    camera_to_wcs,
    celestial,
    celestials,
    pointing,
    tetra3_values,
    write_solution,
)

# Public; the other imports serve other rooms.
__all__ = ["FrameFiles", "Layout", "camera_to_wcs", "celestial"]
