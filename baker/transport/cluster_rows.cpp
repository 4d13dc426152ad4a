// SPDX-License-Identifier: Apache-2.0
#include "baker/transport/cluster_rows.h"

#include "baker/core/parallel.h"
#include "baker/core/random.h"

#include "envbake/runtime/half.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

namespace envbake {

namespace {

constexpr std::size_t kSampleSize = 8192;  ///< rows that clusters are learned from
constexpr std::size_t kMaxWeights = 32;
constexpr std::size_t kTrainingWeights = 8;  ///< directions of a cluster while rows choose
constexpr std::size_t kCandidates = 24;      ///< clusters of the nearest means that a row looks at
constexpr int kIterations = 5;
constexpr std::size_t kBlock = 256;  ///< rows of one call of parallel_for
constexpr std::size_t kClusterCounts[] = {1, 16, 64, 256};

/// A mean and orthonormal directions, the strongest first; those beyond the rank are 0.
struct Subspace {
    std::vector<double> mean;        ///< [D]
    std::vector<double> directions;  ///< [kept, D]
    std::vector<double> energy;      ///< [kept]: sum over members of their squared coordinate
    double spread = 0;               ///< sum over members of |T - mean|^2
};

/// Every row of all parts, by number.
class Rows {
  public:
    Rows(std::span<const std::span<const float>> parts, std::size_t row_size)
        : row_size_(row_size) {
        for (const std::span<const float>& part : parts)
            for (std::size_t at = 0; at < part.size(); at += row_size)
                rows_.push_back(part.data() + at);
    }
    explicit Rows(std::vector<const float*> rows, std::size_t row_size)
        : row_size_(row_size), rows_(std::move(rows)) {}

    std::size_t count() const { return rows_.size(); }
    std::size_t row_size() const { return row_size_; }
    std::span<const float> operator[](std::size_t row) const { return {rows_[row], row_size_}; }

    Rows sample() const {
        if (count() <= kSampleSize) return *this;
        std::vector<const float*> chosen;
        for (std::size_t i = 0; i < kSampleSize; ++i)
            chosen.push_back(rows_[(2 * i + 1) * count() / (2 * kSampleSize)]);
        return Rows(std::move(chosen), row_size_);
    }

  private:
    std::size_t row_size_;
    std::vector<const float*> rows_;
};

double square_distance(std::span<const float> row, std::span<const float> other) {
    double sum = 0;
    for (std::size_t i = 0; i < row.size(); ++i) {
        const double difference = double{row[i]} - double{other[i]};
        sum += difference * difference;
    }
    return sum;
}

/// k-means++ [Arthur07]: each seed with a probability that goes as its squared distance from those
/// before. Fewer where the rows are no more than that.
std::vector<std::size_t> choose_seeds(const Rows& rows, std::size_t count, std::uint64_t seed) {
    RandomStream random(seed, 0x63706361, 0);
    std::vector<double> distance(rows.count(), std::numeric_limits<double>::infinity());
    std::vector<std::size_t> seeds{
        static_cast<std::size_t>(random.next() * static_cast<double>(rows.count()))};
    while (seeds.size() < count) {
        double total = 0;
        for (std::size_t v = 0; v < rows.count(); ++v) {
            distance[v] = std::min(distance[v], square_distance(rows[v], rows[seeds.back()]));
            total += distance[v];
        }
        if (!(total > 0)) break;
        double left = random.next() * total;
        std::size_t chosen = 0;
        for (std::size_t v = 0; v < rows.count(); ++v) {
            if (distance[v] == 0) continue;
            chosen = v;
            if ((left -= distance[v]) < 0) break;
        }
        seeds.push_back(chosen);
    }
    return seeds;
}

/// Makes `vector` orthogonal to the directions before it, of length 1; 0 where nothing is left.
void orthonormalise(std::span<double> vector, std::span<const double> before, double before_it) {
    const std::size_t d = vector.size();
    for (int round = 0; round < 2; ++round)  // the second mends what the first's rounding left
        for (std::size_t at = 0; at < before.size(); at += d) {
            double dot = 0;
            for (std::size_t i = 0; i < d; ++i) dot += vector[i] * before[at + i];
            for (std::size_t i = 0; i < d; ++i) vector[i] -= dot * before[at + i];
        }
    double square = 0;
    for (const double x : vector) square += x * x;
    const double length = std::sqrt(square);
    const bool vanishes = !(length > 1e-12 * before_it) || length < 1e-300;
    for (double& x : vector) x = vanishes ? 0 : x / length;
}

/// The strongest `kept` eigenvectors of the members' covariance, by orthogonal iteration from the
/// directions of before, or from random ones.
Subspace fit(const Rows& rows, std::span<const std::uint32_t> members, std::size_t kept,
             const Subspace& before, std::uint64_t seed) {
    const std::size_t d = rows.row_size();
    Subspace fitted{std::vector<double>(d), std::vector<double>(kept * d),
                    std::vector<double>(kept), 0};
    for (const std::uint32_t v : members)
        for (std::size_t i = 0; i < d; ++i) fitted.mean[i] += double{rows[v][i]};
    for (double& x : fitted.mean) x /= static_cast<double>(members.size());
    std::vector<double> covariance(d * d), centred(d);
    for (const std::uint32_t v : members) {
        for (std::size_t i = 0; i < d; ++i) centred[i] = double{rows[v][i]} - fitted.mean[i];
        for (std::size_t i = 0; i < d; ++i)
            for (std::size_t j = 0; j <= i; ++j) covariance[i * d + j] += centred[i] * centred[j];
    }
    for (std::size_t i = 0; i < d; ++i) {
        fitted.spread += covariance[i * d + i];
        for (std::size_t j = 0; j < i; ++j) covariance[j * d + i] = covariance[i * d + j];
    }

    RandomStream random(seed, 0x62617369, 0);
    std::vector<double>& directions = fitted.directions;
    for (std::size_t i = 0; i < directions.size(); ++i) {
        const double noise = random.next() - 0.5;
        // A little noise lets a direction in that was 0 before.
        directions[i] = i < before.directions.size() ? before.directions[i] + 1e-3 * noise : noise;
    }
    std::vector<double> product(kept * d);
    const int rounds = before.directions.empty() ? 12 : 6;
    for (int round = 0; round < rounds; ++round) {
        std::fill(product.begin(), product.end(), 0.0);
        for (std::size_t k = 0; k < kept; ++k)
            for (std::size_t i = 0; i < d; ++i)
                for (std::size_t j = 0; j < d; ++j)
                    product[k * d + j] += directions[k * d + i] * covariance[i * d + j];
        std::swap(directions, product);
        for (std::size_t k = 0; k < kept; ++k)
            orthonormalise(std::span(directions).subspan(k * d, d),
                           std::span(directions).first(k * d), fitted.spread);
    }
    for (std::size_t k = 0; k < kept; ++k)
        for (std::size_t i = 0; i < d; ++i)
            for (std::size_t j = 0; j < d; ++j)
                fitted.energy[k] +=
                    directions[k * d + i] * covariance[i * d + j] * directions[k * d + j];
    return fitted;
}

/// Subspaces as rows are compared with them: in float, laid out so that a loop over means, or over
/// the directions of one, is a loop over neighbours.
class Assigner {
  public:
    Assigner(std::span<const Subspace> subspaces, std::size_t row_size, std::size_t weights)
        : count_(subspaces.size()),
          row_size_(row_size),
          weights_(weights),
          means_(row_size * count_),
          mean_squares_(count_),
          directions_(count_ * row_size * weights) {
        for (std::size_t c = 0; c < count_; ++c) {
            for (std::size_t i = 0; i < row_size; ++i) {
                const double mean = subspaces[c].mean[i];
                means_[i * count_ + c] = static_cast<float>(mean);
                mean_squares_[c] += static_cast<float>(mean * mean);
                for (std::size_t k = 0;
                     k < weights && k * row_size < subspaces[c].directions.size(); ++k)
                    directions_[(c * row_size + i) * weights + k] =
                        static_cast<float>(subspaces[c].directions[k * row_size + i]);
            }
        }
    }

    /// The nearest of the subspaces, and the squared distance to it.
    std::pair<std::uint16_t, float> nearest(std::span<const float> row) const {
        std::vector<float> distance(mean_squares_);
        for (std::size_t i = 0; i < row_size_; ++i) {
            const float x = -2 * row[i];
            const float* mean = &means_[i * count_];
            for (std::size_t c = 0; c < count_; ++c) distance[c] += x * mean[c];
        }
        std::vector<std::uint16_t> order(count_);
        std::iota(order.begin(), order.end(), std::uint16_t{0});
        const auto candidates =
            static_cast<std::ptrdiff_t>(std::min<std::size_t>(kCandidates, count_));
        std::partial_sort(order.begin(), order.begin() + candidates, order.end(),
                          [&](std::uint16_t a, std::uint16_t b) {
                              return std::pair(distance[a], a) < std::pair(distance[b], b);
                          });
        std::pair<std::uint16_t, float> best{order[0], std::numeric_limits<float>::infinity()};
        std::vector<float> coordinates(weights_);
        for (std::ptrdiff_t at = 0; at < candidates; ++at) {
            const std::size_t c = order[static_cast<std::size_t>(at)];
            std::fill(coordinates.begin(), coordinates.end(), 0.0f);
            float square = 0;
            for (std::size_t i = 0; i < row_size_; ++i) {
                const float x = row[i] - means_[i * count_ + c];
                square += x * x;
                const float* direction = &directions_[(c * row_size_ + i) * weights_];
                for (std::size_t k = 0; k < weights_; ++k) coordinates[k] += x * direction[k];
            }
            for (const float x : coordinates) square -= x * x;
            if (square < best.second) best = {static_cast<std::uint16_t>(c), square};
        }
        return best;
    }

  private:
    std::size_t count_, row_size_, weights_;
    std::vector<float> means_;         ///< [D, clusters]
    std::vector<float> mean_squares_;  ///< [clusters]
    std::vector<float> directions_;    ///< [clusters, D, weights]
};

/// Rows and the clusters that they have chosen.
struct Clustering {
    std::vector<Subspace> subspaces;
    std::vector<std::uint16_t> cluster;               ///< [rows]
    std::vector<float> distance;                      ///< [rows], squared
    std::vector<std::vector<std::uint32_t>> members;  ///< [clusters], ascending
};

void assign(const Rows& rows, std::size_t weights, Clustering& clustering) {
    const Assigner assigner(clustering.subspaces, rows.row_size(), weights);
    clustering.cluster.resize(rows.count());
    clustering.distance.resize(rows.count());
    parallel_for((rows.count() + kBlock - 1) / kBlock, [&](std::size_t block) {
        const std::size_t end = std::min((block + 1) * kBlock, rows.count());
        for (std::size_t v = block * kBlock; v < end; ++v)
            std::tie(clustering.cluster[v], clustering.distance[v]) = assigner.nearest(rows[v]);
    });
    clustering.members.assign(clustering.subspaces.size(), {});
    for (std::size_t v = 0; v < rows.count(); ++v)
        clustering.members[clustering.cluster[v]].push_back(static_cast<std::uint32_t>(v));
}

/// Clusters that nobody chose begin again at the rows that are worst off.
void refill_empty(const Rows& rows, Clustering& clustering) {
    std::vector<std::uint32_t> worst(rows.count());
    std::iota(worst.begin(), worst.end(), 0u);
    const auto empty = static_cast<std::ptrdiff_t>(
        std::count_if(clustering.members.begin(), clustering.members.end(),
                      [](const auto& members) { return members.empty(); }));
    std::partial_sort(
        worst.begin(), worst.begin() + empty, worst.end(), [&](std::uint32_t a, std::uint32_t b) {
            return std::pair(-clustering.distance[a], a) < std::pair(-clustering.distance[b], b);
        });
    std::size_t next = 0;
    for (auto& members : clustering.members)
        if (members.empty()) members.push_back(worst[next++]);
}

void fit_all(const Rows& rows, std::size_t kept, std::uint64_t seed, Clustering& clustering) {
    parallel_for(clustering.subspaces.size(), [&](std::size_t c) {
        clustering.subspaces[c] =
            fit(rows, clustering.members[c], kept, clustering.subspaces[c], seed);
    });
}

Clustering train(const Rows& rows, std::size_t count, std::uint64_t seed) {
    const std::size_t kept = std::min(rows.row_size(), kMaxWeights);
    Clustering clustering;
    for (const std::size_t v : choose_seeds(rows, count, seed))
        clustering.subspaces.push_back({{rows[v].begin(), rows[v].end()}, {}, {}, 0});
    for (int iteration = 0; iteration < kIterations; ++iteration) {
        assign(rows, std::min(kept, kTrainingWeights), clustering);
        refill_empty(rows, clustering);
        fit_all(rows, kept, seed, clustering);
    }
    return clustering;
}

/// Mean square distance of rows to subspaces of n directions.
double mean_square(const Clustering& clustering, std::size_t rows, std::size_t n) {
    double sum = 0;
    for (const Subspace& s : clustering.subspaces) {
        sum += s.spread;
        for (std::size_t k = 0; k < std::min(n, s.energy.size()); ++k) sum -= s.energy[k];
    }
    return std::max(0.0, sum) / static_cast<double>(rows);
}

double stored_bytes(const ClusterJob& job, std::size_t rows, std::size_t clusters, std::size_t n) {
    return static_cast<double>(rows) * static_cast<double>(n + (clusters > 256 ? 2 : 1)) +
           static_cast<double>(clusters * (n + 1) * job.row_size * (job.half_basis ? 2 : 4));
}

float stored(double value, bool half) {
    const auto single = static_cast<float>(value);
    return half ? runtime::half_to_float(runtime::float_to_half(single)) : single;
}

/// Weights of 8 bits for all members of one cluster; returns the sum of their squared errors.
double quantise(const ClusterJob& job, const Rows& rows, const Subspace& subspace,
                std::span<const std::uint32_t> members, std::size_t n, std::span<float> basis,
                std::span<std::uint8_t> weights) {
    const std::size_t d = job.row_size;
    std::vector<double> coordinates(members.size() * n);
    std::vector<double> low(n, std::numeric_limits<double>::infinity()), high(n, -low[0]);
    for (std::size_t m = 0; m < members.size(); ++m)
        for (std::size_t k = 0; k < n; ++k) {
            double x = 0;
            for (std::size_t i = 0; i < d; ++i)
                x += (double{rows[members[m]][i]} - subspace.mean[i]) *
                     subspace.directions[k * d + i];
            coordinates[m * n + k] = x;
            low[k] = std::min(low[k], x);
            high[k] = std::max(high[k], x);
        }
    std::vector<double> step(n);
    for (std::size_t k = 0; k < n; ++k) step[k] = (high[k] - low[k]) / 255;
    for (std::size_t i = 0; i < d; ++i) {
        double base = subspace.mean[i];
        for (std::size_t k = 0; k < n; ++k) {
            base += low[k] * subspace.directions[k * d + i];
            basis[(1 + k) * d + i] =
                stored(step[k] * subspace.directions[k * d + i], job.half_basis);
        }
        basis[i] = stored(base, job.half_basis);
    }
    double square_sum = 0;
    for (std::size_t m = 0; m < members.size(); ++m) {
        std::uint8_t* q = &weights[members[m] * n];
        for (std::size_t k = 0; k < n; ++k)
            q[k] = step[k] > 0
                       ? static_cast<std::uint8_t>(std::clamp(
                             std::round((coordinates[m * n + k] - low[k]) / step[k]), 0.0, 255.0))
                       : std::uint8_t{0};
        for (std::size_t i = 0; i < d; ++i) {
            double value = double{basis[i]};
            for (std::size_t k = 0; k < n; ++k) value += q[k] * double{basis[(1 + k) * d + i]};
            const double error = double{rows[members[m]][i]} - value;
            square_sum += error * error;
        }
    }
    return square_sum;
}

ClusteredRows quantise(const ClusterJob& job, const Rows& rows, const Clustering& clustering,
                       std::size_t n) {
    const std::size_t count = clustering.subspaces.size(), stride = (1 + n) * job.row_size;
    ClusteredRows result{n,
                         clustering.cluster,
                         std::vector<std::uint8_t>(rows.count() * n),
                         std::vector<float>(count * stride),
                         job.half_basis,
                         0};
    std::vector<double> square_sums(count);
    parallel_for(count, [&](std::size_t c) {
        square_sums[c] =
            quantise(job, rows, clustering.subspaces[c], clustering.members[c], n,
                     std::span(result.basis).subspan(c * stride, stride), result.weights);
    });
    result.error_rms = std::sqrt(std::accumulate(square_sums.begin(), square_sums.end(), 0.0) /
                                 static_cast<double>(rows.count()));
    return result;
}

/// Leaves out clusters without members.
void drop_empty(Clustering& clustering) {
    std::size_t kept = 0;
    for (std::size_t c = 0; c < clustering.subspaces.size(); ++c) {
        if (clustering.members[c].empty()) continue;
        for (const std::uint32_t v : clustering.members[c])
            clustering.cluster[v] = static_cast<std::uint16_t>(kept);
        if (kept != c) {
            clustering.subspaces[kept] = std::move(clustering.subspaces[c]);
            clustering.members[kept] = std::move(clustering.members[c]);
        }
        ++kept;
    }
    clustering.subspaces.resize(kept);
    clustering.members.resize(kept);
}

}  // namespace

std::uint64_t ClusteredRows::bytes(const ClusterJob& job) const {
    return static_cast<std::uint64_t>(
        stored_bytes(job, clusters.size(), cluster_count(job.row_size), weight_count));
}

void ClusteredRows::decode(std::size_t row, std::span<float> out) const {
    const float* rows = &basis[clusters[row] * (1 + weight_count) * out.size()];
    for (std::size_t i = 0; i < out.size(); ++i) {
        double value = double{rows[i]};
        for (std::size_t k = 0; k < weight_count; ++k)
            value += weights[row * weight_count + k] * double{rows[(1 + k) * out.size() + i]};
        out[i] = static_cast<float>(value);
    }
}

ClusteredRows cluster_rows(const ClusterJob& job, std::span<const std::span<const float>> parts) {
    const Rows rows(parts, job.row_size);
    if (rows.count() == 0) return {};
    const Rows sample = rows.sample();
    const std::size_t most = std::min(job.row_size, kMaxWeights);
    const double aim = job.tolerance * job.tolerance;

    Clustering best;
    std::size_t best_n = most;
    double least_error = std::numeric_limits<double>::infinity(), least_bytes = least_error;
    for (const std::size_t count : kClusterCounts) {
        if (least_error <= job.tolerance && stored_bytes(job, rows.count(), count, 1) > least_bytes)
            break;
        Clustering trained = train(sample, count, job.seed);
        std::size_t n = 1;
        while (n < most && mean_square(trained, sample.count(), n) > aim) ++n;
        double error = quantise(job, sample, trained, n).error_rms;
        while (error > job.tolerance && n < most)
            error = quantise(job, sample, trained, ++n).error_rms;
        const double bytes = stored_bytes(job, rows.count(), trained.subspaces.size(), n);
        // Whatever keeps to the tolerance is as good as any other that does.
        const auto judged = [&](double of_error) { return std::max(of_error, job.tolerance); };
        if (std::pair(judged(error), bytes) >= std::pair(judged(least_error), least_bytes))
            continue;
        least_error = error;
        least_bytes = bytes;
        best_n = n;
        best = std::move(trained);
    }

    assign(rows, std::min(most, best_n), best);
    drop_empty(best);
    fit_all(rows, most, job.seed, best);
    ClusteredRows result = quantise(job, rows, best, best_n);
    while (result.error_rms > job.tolerance && best_n < most)
        result = quantise(job, rows, best, ++best_n);
    return result;
}

}  // namespace envbake
