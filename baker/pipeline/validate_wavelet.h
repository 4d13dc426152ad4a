// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/pipeline/format_rules.h"
#include "baker/pipeline/json_text.h"
#include "envbake/format/reader.h"

#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace envbake {

/// Whether docs/format.md knows this name as one of the wavelet arrays.
bool is_wavelet_name(std::string_view name);

/// The I of "mesh/I/wavelet/..."; none of other names, nor of those that the format does not know.
std::optional<std::uint64_t> mesh_of_wavelet(std::string_view name);

/// What the rules 190 to 199 say of the wavelet arrays and of the metadata that goes with them.
void check_wavelets(const format::Reader& reader, const Json& metadata,
                    const std::function<void(const FormatRule&, std::string)>& add);

}  // namespace envbake
