// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/lobe_light.h"

#include "baker/core/parallel.h"
#include "envbake/runtime/half.h"
#include "envbake/runtime/lobe.h"
#include "envbake/runtime/sh.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace envbake {

namespace {

using runtime::kLobeBands;

/// Differences of light that a lobe meets, of all columns.
AxialMoments moments(std::span<const double> first, std::span<const double> second,
                     std::size_t columns) {
    AxialMoments sums(kLobeBands);
    std::array<double, sh::coeff_count(kLobeBands)> x;
    for (std::size_t i = 0; i < columns; ++i) {
        for (std::size_t k = 0; k < x.size(); ++k)
            x[k] = first[k * columns + i] - second[k * columns + i];
        sums.add(x);
    }
    return sums;
}

/// The largest over a lobe's roughness and distributions.
double largest(const std::vector<AxialForm>& forms, const AxialMoments& of) {
    double most = 0;
    for (const AxialForm& form : forms) most = std::max(most, form(of));
    return most;
}

}  // namespace

LobeLight::LobeLight(const LobeLightJob& job, int channels, RowOf row_of, SeenSurfaces truth)
    : job_(job),
      sums_{.bands = kLobeBands,
            .columns = static_cast<std::size_t>(sh::coeff_count(job.light_bands) * channels),
            .channels = channels,
            .row_of = std::move(row_of)},
      truth_(std::move(truth)) {}

LobeLight::Errors& LobeLight::Errors::operator*=(double factor) {
    noise *= factor;
    for (double& error : rms) error *= factor;
    for (double& error : p999) error *= factor;
    return *this;
}

std::vector<LobeLight::Errors> LobeLight::errors(const SeenSurfaces& seen, double stride,
                                                 double exponent) const {
    static const Frame about_normal{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    const std::size_t count = truth_.row_count(), columns = sums_.columns;
    // Of more bands than the lighting has, "mesh/I/glossy" has not the products.
    const int most_bands = std::min(runtime::kMaxReflectedBands, job_.light_bands);
    // [place]: of what all bands would bring, then of one band, of two, ...
    std::vector<std::vector<AxialMoments>> of_places(count);
    parallel_for(count, [&](std::size_t i) {
        const ReflectedLight truth(sums_, truth_, i, about_normal);
        const ReflectedLight found(sums_, seen, i, about_normal);
        const std::vector<double> met = truth.met();
        of_places[i].push_back(moments(found.met(), met, columns));
        for (int bands = 1; bands <= most_bands; ++bands)
            of_places[i].push_back(moments(truth.met(found, bands), met, columns));
    });

    // The two sets differ by the errors of both; the truth's part goes by their numbers of rays.
    const double truth_part = 1 / (1 + std::pow(stride, 2 * exponent));
    const double channels = sums_.channels;
    std::vector<Errors> errors(job_.errors.size());
    for (std::size_t lobe = 0; lobe < errors.size() && count > 0; ++lobe) {
        std::vector<std::vector<double>> squares(of_places[0].size());
        std::vector<double> means;
        for (std::size_t k = 0; k < squares.size(); ++k) {
            double sum = 0;
            for (const std::vector<AxialMoments>& of_place : of_places) {
                squares[k].push_back(largest(job_.errors[lobe], of_place[k]) / channels);
                sum += squares[k].back();
            }
            means.push_back(sum / static_cast<double>(count));
        }
        errors[lobe].noise = std::sqrt(means[0] * (1 - truth_part));
        // Bands are met where the truth's points are: of its errors they have less than means[0],
        // which has those of its directions, too.
        const double of_truth = *std::min_element(means.begin(), means.end()) * truth_part;
        for (std::size_t k = 1; k < squares.size(); ++k) {
            std::sort(squares[k].begin(), squares[k].end());
            errors[lobe].rms.push_back(std::sqrt(means[k] - of_truth));
            errors[lobe].p999.push_back(std::sqrt(squares[k][count - 1 - count / 1000]));
        }
    }
    return errors;
}

std::vector<std::uint16_t> LobeLight::stored_row(const SeenSurfaces& seen, std::size_t row,
                                                 const DVec3& normal, int bands) const {
    ReflectedLight::Job job = sums_;
    job.bands = bands;
    std::vector<std::uint16_t> halves;
    for (const float r : ReflectedLight(job, seen, row, frame_about(normal)).variation(bands))
        halves.push_back(runtime::float_to_half(r));
    return halves;
}

LobeLightReport choose_bands(const LobeLight::Errors& errors, double allowed) {
    const auto found = std::find_if(errors.rms.begin(), errors.rms.end(),
                                    [&](double rms) { return rms <= allowed; });
    const auto chosen =
        found != errors.rms.end() ? found : std::min_element(errors.rms.begin(), errors.rms.end());
    const auto at = static_cast<std::size_t>(chosen - errors.rms.begin());
    return {static_cast<int>(at) + 1, 0, errors.rms[at], errors.p999[at]};
}

}  // namespace envbake
