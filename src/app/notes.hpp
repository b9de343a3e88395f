#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "io/scene.hpp"

namespace sweepvi::app {

struct Summary;

/// Something about a run that is not as it was asked for, though the run is done: nothing of the kind happens
/// in silence. Notes stand in the last lines of a run, in the summary (`notes`) and in its file (attribute
/// `notes`).
struct Note {
  std::string kind;        ///< a word for scripts, see README.md, "Summary"
  std::int64_t count = 0;  ///< how often
  std::string text;        ///< a sentence, without a full stop
};

/// The notes of a run, from what was asked and what was counted. @note Not collective, the same on all ranks.
std::vector<Note> notes_of(const TimeSpec& time, const Summary& summary);

/// What there is to say of a run before its first step.
std::vector<Note> notes_before(const TimeSpec& time);

/// One a line, as the attribute of the file has them.
std::string lines_of(const std::vector<Note>& notes);

}  // namespace sweepvi::app
