#pragma once

#include <optional>
#include <string>
#include <vector>

#include "io/sparse_entries.hpp"

namespace sweepvi {

class FileSource;

// The readers below are serial: one rank reads and hands out. Matrices stored densely come without their
// zeros, those stored sparsely keep the zeros they name. Entries named twice are summed. At most 2^31 - 1
// rows, columns and entries, because PETSc may count them in 32 bits. What a file says about sizes is held
// against its length and the memory there is before it is believed. All throw Error (bad_input) with the
// file, the line or dataset, what was found and what was expected.

/// A matrix in a file. What kind of file it is its first bytes tell, whatever its name; all but HDF5 files
/// and zip archives may be packed by gzip.
///
///   MatrixMarket   read_matrix_market(), below
///   NumPy          .npy with two axes, in C or Fortran order; .npz of scipy.sparse.save_npz (csr, csc, coo,
///   bsr,
///                  dia), or of numpy.savez, where `dataset` names the array if there are several
///   PETSc binary   of MatView: AIJ and all that are written as AIJ, dense; indices of 32 or 64 bits. SBAIJ
///                  matrices are written as their upper triangle, without a mark, and are read as that.
///   HDF5           read_hdf5_matrix(), below; `dataset` is needed
///
/// @param dataset  empty: the only one there is
SparseEntries read_matrix_file(const std::string& path, const std::string& dataset = "");

/// A vector in such a file: an array of one axis, a PETSc vector, or a matrix of one column or row.
/// @param infinity  whether infinite numbers are welcome, where a format has them (not in MatrixMarket)
std::vector<double> read_vector_file(const std::string& path, const std::string& dataset = "",
                                     bool infinity = false);

/// Why a file cannot be one of these: it is missing, or begins like none of them; empty if there is no such
/// reason.
std::string why_no_matrix_file(const std::string& path);

/// For a complaint that no dataset is named: "; FILE holds /A, /B", or "" for an HDF5 file that is missing.
/// Nothing if `path` needs no dataset.
std::optional<std::string> datasets_to_choose_from(const std::string& path);

/// A MatrixMarket file: coordinate or array; real, integer or pattern (values 1); general, symmetric or
/// skew-symmetric (the file then holds one triangle, and of a skew-symmetric matrix perhaps the zeros of its
/// diagonal). A byte-order mark, Windows line ends, comments behind numbers and Fortran's exponents are
/// understood. Source: R. F. Boisvert, R. Pozo, K. A. Remington, The Matrix Market Exchange Formats, NISTIR
/// 5935 (1996).
SparseEntries read_matrix_market(FileSource& source);

// NumPy's .npy: numpy/lib/format.py, versions 1 to 3. .npz: a zip archive of those.
SparseEntries read_numpy_matrix(FileSource& source);
std::vector<double> read_numpy_vector(FileSource& source, bool infinity);
SparseEntries read_numpy_archive_matrix(const std::string& path, const std::string& dataset);
std::vector<double> read_numpy_archive_vector(const std::string& path, const std::string& dataset,
                                              bool infinity);

// What PETSc's MatView and VecView write to a binary viewer: big-endian, objects one after another, of which
// exactly one must be of the kind that is wanted.
SparseEntries read_petsc_matrix(FileSource& source);
std::vector<double> read_petsc_vector(FileSource& source, bool infinity);

/// An HDF5 dataset with two axes, or a group that holds a sparse matrix:
///
///   data, indices, indptr and shape   compressed rows (csr, also where nothing is said) or columns (csc), as
///                                     `format`, `encoding-type`, `h5sparse_format` or any other text
///                                     attribute says
///   row, col, data and shape          marked as coo in the same way
///   ir, jc, data, MATLAB_sparse       compressed columns, as MATLAB -v7.3 writes them and PETSc's viewer has
///   them colptr, rowval, nzval, m, n       compressed columns numbered from 1: Julia's SparseMatrixCSC type,
///   value                       what Octave's `save -hdf5` makes of a matrix
///
/// Dense datasets are read as HDF5 says, rows x columns, but with the axes exchanged where it is written down
/// that a program with column-major arrays wrote them: attribute MATLAB_class, a file that begins as MATLAB's
/// MAT-files or Julia's JLD and JLD2 do, a value of Octave. Others that exchange axes leave no mark: HDF5.jl,
/// MATLAB's h5write, Armadillo, R.
SparseEntries read_hdf5_matrix(const std::string& path, const std::string& dataset);

/// An HDF5 dataset with one axis, or with two of which one has length 1; or a group as above with such a
/// matrix.
/// @param infinity  whether numbers that are not finite are the caller's business
std::vector<double> read_hdf5_vector(const std::string& path, const std::string& dataset,
                                     bool infinity = false);

}  // namespace sweepvi
