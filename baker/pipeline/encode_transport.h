// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "baker/plan/bake_request.h"
#include "baker/transport/cluster_rows.h"
#include "baker/transport/row_encoding.h"

#include "envbake/format/layout.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace envbake {

/// How a bundle stores elements of rows, and the other way round.
format::ElementType element_type(RowEncoding encoding);
std::optional<RowEncoding> row_encoding(format::ElementType type);

/// The transport of one mesh.
struct TransportPart {
    std::size_t mesh = 0;
    std::span<const float> rows;
};

struct EncodedPart {
    Encoding encoding = Encoding::F32;  ///< never Auto
    RowCode code;                       ///< where it is not clustered
    std::size_t first_row = 0;          ///< in the clusters, where it is
    RowError error;                     ///< of |T - T'|_2

    bool clustered() const { return encoding == Encoding::Clustered; }
};

struct EncodedTransport {
    std::vector<EncodedPart> parts;  ///< in the order given
    ClusteredRows clusters;          ///< empty where nothing is clustered
};

/// Decides how transport is stored, and measures what that costs. Auto takes for each mesh the
/// smallest of unorm8, unorm16 and f32 whose error keeps to the tolerance, or clusters for all of
/// them, where these do too and are smaller. f16 never is: unorm16 is as small, and 30 times
/// closer.
///
///   tolerance   rms over rows of |T - T'|_2
///   relative    the same, relative to an unoccluded row
EncodedTransport encode_transport(Encoding encoding, std::span<const TransportPart> parts,
                                  std::size_t row_size, double tolerance, double relative,
                                  std::uint64_t seed);

}  // namespace envbake
