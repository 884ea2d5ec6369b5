#include "sfm/unfolding.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

namespace rotunda::sfm {
namespace {

constexpr double kMinCount = 6;
/// Starts: regions of which at least this share of the pairs meets almost nothing.
constexpr std::array<double, 5> kStartShares = {0.1, 0.2, 0.3, 0.4, 0.55};
constexpr uint32_t kMinPairCount = 4;
constexpr double kAlmostNothing = 0.12;
constexpr int kMaxRounds = 6;
constexpr int kMaxMoves = 20;
/// Log-likelihood that the heaviest edge of both its images joins what belongs together; that of
/// lighter ones falls with this power of their share of the weight.
constexpr double kPriorOfHeaviest = 5.0;
constexpr double kPriorPower = 4.0;

/// Symmetric, by image: log-likelihood that two images belong together.
using Affinity = std::vector<std::vector<double>>;

/// What the view graph alone says: an image belongs with those it is most like. Decides where the
/// regions tell little; crossed edges are rarely the heaviest of both their images.
Affinity PriorAffinity(const Covisibility& covisibility, const ViewGraph& graph) {
  std::vector<double> heaviest(covisibility.images, 0.0);
  for (const ViewGraphEdge& edge : graph.edges) {
    for (const ImageId image : {edge.pair.first, edge.pair.second}) {
      heaviest[image.index()] = std::max(heaviest[image.index()], edge.weight);
    }
  }
  Affinity affinity(covisibility.images, std::vector<double>(covisibility.images, 0.0));
  for (const ViewGraphEdge& edge : graph.edges) {
    const size_t i = edge.pair.first.index(), j = edge.pair.second.index();
    const double share = edge.weight / std::max(heaviest[i], heaviest[j]);
    affinity[i][j] = affinity[j][i] = kPriorOfHeaviest * std::pow(share, kPriorPower);
  }
  return affinity;
}

void AddEvidence(const Covisibility& covisibility, const std::vector<bool>& telling,
                 Affinity& affinity) {
  const double met = std::log(kMetShare / kMetByChance);
  const double missed = std::log((1 - kMetShare) / (1 - kMetByChance));
  for (size_t r = 0; r < covisibility.regions.size(); ++r) {
    if (!telling[r]) continue;
    const RegionCovisibility& region = covisibility.regions[r];
    for (const PairCount& count : region.pairs) {
      const double evidence =
          region.independence * (count.met * met + (count.expected - count.met) * missed);
      const size_t i = count.pair.first.index(), j = count.pair.second.index();
      affinity[i][j] += evidence;
      affinity[j][i] += evidence;
    }
  }
}

/// Groups joined pair by pair, the one with the largest sum of affinities first, while it is
/// positive.
std::vector<int> Agglomerate(Affinity sums, std::vector<int> group) {
  const size_t n = sums.size();
  std::vector<bool> alive(n);
  for (size_t i = 0; i < n; ++i) alive[i] = group[i] != kNoGroup;
  while (true) {
    double best = 0;
    size_t a = 0, b = 0;
    for (size_t i = 0; i < n; ++i) {
      if (!alive[i]) continue;
      for (size_t j = i + 1; j < n; ++j) {
        if (alive[j] && sums[i][j] > best) best = sums[i][j], a = i, b = j;
      }
    }
    if (best <= 0) return group;
    for (size_t k = 0; k < n; ++k) sums[a][k] = sums[k][a] = sums[a][k] + sums[b][k];
    alive[b] = false;
    for (int& g : group) {
      if (g == static_cast<int>(b)) g = static_cast<int>(a);
    }
  }
}

/// Sum of the affinities of an image with every group.
std::map<int, double> SumsByGroup(const Affinity& affinity, const std::vector<int>& group,
                                  size_t image) {
  std::map<int, double> sums;
  for (size_t j = 0; j < group.size(); ++j) {
    if (j != image && group[j] != kNoGroup) sums[group[j]] += affinity[image][j];
  }
  return sums;
}

std::vector<int> Cluster(const Affinity& affinity, const std::vector<int>& singles) {
  std::vector<int> group = Agglomerate(affinity, singles);
  for (int round = 0; round < kMaxMoves; ++round) {
    bool moved = false;
    for (size_t i = 0; i < group.size(); ++i) {
      if (group[i] == kNoGroup) continue;
      const std::map<int, double> sums = SumsByGroup(affinity, group, i);
      const auto own = sums.find(group[i]);
      double best = own == sums.end() ? 0.0 : own->second;
      for (const auto& [other, sum] : sums) {
        if (sum <= best + 1e-9) continue;
        best = sum;
        group[i] = other;
        moved = true;
      }
    }
    if (!moved) break;
  }
  return group;
}

struct Tally {
  double expected = 0, met = 0;
  double Rate() const { return expected > 0 ? met / expected : 0; }
  double LogLikelihood() const {
    const double rate = std::clamp(Rate(), 0.005, 0.995);
    return met * std::log(rate) + (expected - met) * std::log(1 - rate);
  }
};

/// What a labelling makes of the regions.
struct Reading {
  std::vector<bool> telling;
  double gain = 0;  // less what it takes to describe the labelling
};

/// Natural units of information: which of `counts` each item belongs to.
double DescriptionLength(const std::vector<size_t>& counts) {
  const double all = static_cast<double>(std::accumulate(counts.begin(), counts.end(), size_t{0}));
  double length = 0;
  for (const size_t count : counts) {
    if (count > 0)
      length += static_cast<double>(count) * std::log(all / static_cast<double>(count));
  }
  return length;
}

/// Of the groups of the images and of the choice of telling regions.
double DescriptionLength(const std::vector<int>& group, const std::vector<bool>& telling) {
  std::map<int, size_t> sizes;
  for (const int g : group) {
    if (g != kNoGroup) ++sizes[g];
  }
  std::vector<size_t> counts;
  for (const auto& [g, size] : sizes) counts.push_back(size);
  const auto chosen = static_cast<size_t>(std::count(telling.begin(), telling.end(), true));
  return DescriptionLength(counts) + DescriptionLength({chosen, telling.size() - chosen});
}

Reading Read(const Covisibility& covisibility, const std::vector<int>& group) {
  Reading reading{std::vector<bool>(covisibility.regions.size(), false), 0};
  for (size_t r = 0; r < covisibility.regions.size(); ++r) {
    const RegionCovisibility& region = covisibility.regions[r];
    Tally within, across;
    for (const PairCount& count : region.pairs) {
      const bool same = group[count.pair.first.index()] == group[count.pair.second.index()];
      Tally& tally = same ? within : across;
      tally.expected += region.independence * count.expected;
      tally.met += region.independence * count.met;
    }
    if (within.expected < kMinCount || across.expected < kMinCount) continue;
    if (across.Rate() > kMissedRatio * within.Rate()) continue;
    const Tally all{within.expected + across.expected, within.met + across.met};
    reading.telling[r] = true;
    reading.gain += within.LogLikelihood() + across.LogLikelihood() - all.LogLikelihood();
  }
  reading.gain -= DescriptionLength(group, reading.telling);
  return reading;
}

std::vector<bool> StartingRegions(const Covisibility& covisibility, double share) {
  std::vector<bool> telling;
  for (const RegionCovisibility& region : covisibility.regions) {
    size_t pairs = 0, nothing = 0;
    for (const PairCount& count : region.pairs) {
      if (count.expected < kMinPairCount) continue;
      ++pairs;
      nothing += count.met <= kAlmostNothing * count.expected;
    }
    telling.push_back(pairs >= kMinPairCount &&
                      static_cast<double>(nothing) >= share * static_cast<double>(pairs));
  }
  return telling;
}

/// Groups numbered by size (ties: smallest image).
size_t Renumber(std::vector<int>& group) {
  std::map<int, std::pair<int, int>> order;  // by old name: -size, first image
  for (size_t i = 0; i < group.size(); ++i) {
    if (group[i] == kNoGroup) continue;
    const auto [entry, added] = order.try_emplace(group[i], 0, static_cast<int>(i));
    --entry->second.first;
  }
  std::vector<std::pair<std::pair<int, int>, int>> sorted;
  for (const auto& [name, key] : order) sorted.emplace_back(key, name);
  std::sort(sorted.begin(), sorted.end());
  std::map<int, int> renamed;
  for (size_t g = 0; g < sorted.size(); ++g) renamed[sorted[g].second] = static_cast<int>(g);
  for (int& g : group) {
    if (g != kNoGroup) g = renamed[g];
  }
  return sorted.size();
}

std::vector<double> Certainties(const Affinity& affinity, const std::vector<int>& group) {
  std::vector<double> certainty;
  for (size_t i = 0; i < group.size(); ++i) {
    double own = 0, other = -std::numeric_limits<double>::infinity();
    for (const auto& [g, sum] : SumsByGroup(affinity, group, i)) {
      if (g == group[i]) {
        own = sum;
      } else {
        other = std::max(other, sum);
      }
    }
    certainty.push_back(group[i] == kNoGroup ? 0 : own - other);
  }
  return certainty;
}

/// All images of the graph in one group.
LookAlikeGroups OneGroup(const std::vector<int>& singles) {
  LookAlikeGroups one;
  one.of_image = singles;
  for (int& g : one.of_image) g = std::min(g, 0);
  one.count = 1;
  one.certainty.assign(singles.size(), std::numeric_limits<double>::infinity());
  return one;
}

LookAlikeGroups Describe(const Covisibility& covisibility, const Affinity& prior,
                         std::vector<int> group, const Reading& reading) {
  LookAlikeGroups groups;
  groups.gain = reading.gain;
  Affinity affinity = prior;
  AddEvidence(covisibility, reading.telling, affinity);
  groups.certainty = Certainties(affinity, group);
  groups.count = Renumber(group);
  groups.of_image = std::move(group);
  return groups;
}

}  // namespace

LookAlikeGroups FindLookAlikeGroups(const Covisibility& covisibility, const ViewGraph& graph) {
  const Affinity prior = PriorAffinity(covisibility, graph);
  std::vector<int> singles(covisibility.images, kNoGroup);
  for (const ViewGraphEdge& edge : graph.edges) {
    for (const ImageId image : {edge.pair.first, edge.pair.second}) {
      singles[image.index()] = static_cast<int>(image.index());
    }
  }
  LookAlikeGroups best = OneGroup(singles);
  for (const double share : kStartShares) {
    std::vector<bool> telling = StartingRegions(covisibility, share);
    for (int round = 0; round < kMaxRounds; ++round) {
      Affinity affinity = prior;
      AddEvidence(covisibility, telling, affinity);
      std::vector<int> group = Cluster(affinity, singles);
      Reading reading = Read(covisibility, group);
      if (reading.gain > best.gain) best = Describe(covisibility, prior, group, reading);
      if (reading.telling == telling) break;
      telling = std::move(reading.telling);
    }
  }
  return best;
}

}  // namespace rotunda::sfm
