#pragma once

#include <string>
#include <vector>

namespace sweepvi::app {

/// PETSc options that a scene of somebody else may set. Many others open files, show themselves in viewers
/// (which may be files and sockets), load libraries or start debuggers; so what is not on the list is
/// refused, and so is every value that is more than a number or a word.
///
/// Needs neither MPI nor PETSc.
/// @param words  options and values, as on a command line
/// @return why they are refused; empty: they may be used
std::string why_refused(const std::vector<std::string>& words);

/// The same for a text that PETSc would split into words.
std::string why_refused(const std::string& text);

}  // namespace sweepvi::app
