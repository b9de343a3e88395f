#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace sweepvi {

/// A text as it may stand in a message, a log or a report, whoever wrote it: UTF-8 whose every character can
/// be seen where it stands. Control characters (C0, DEL, C1), separators of lines and paragraphs, marks that
/// change the direction of writing, characters without width and bytes that are no UTF-8 come out as `\n`,
/// `\t`, `\x1b` or `\u{202e}`; so no text forges a line, moves a cursor or hides what it says. Everything
/// else is kept, a backslash too.
std::string printable(std::string_view text);

/// The same, but for ends of lines and tabs, which stay: for texts of several lines.
std::string printable_lines(std::string_view text);

/// A word of a file in quotes, 'word': at most `most` bytes of it and then "..."; printable.
std::string in_quotes(std::string_view word, std::size_t most = 40);

}  // namespace sweepvi
