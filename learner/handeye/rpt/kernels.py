"""The compiled loops of the learner: construction, beam search, exact search and local fits.

Everything here takes contiguous float64 and int64 arrays, checks nothing and raises nothing; `tree` and
`approximate` check and raise. A `tree` argument is a `handeye.rpt.tree.Tree`. With `NUMBA_DISABLE_JIT=1` the same
functions run as plain Python.

Symbols: n samples of d components, m tree nodes, k neighbours, p outputs.
"""

import math

import numpy as np
from numba import njit

# Covering bounds are differences of rounded distances; they are loosened by this share of the distances, far above
# the rounding error and far below any distance that matters.
SLACK = 1e-13

SQRT2 = math.sqrt(2.0)


@njit(cache=True, nogil=True)
def distance(a, b):
    """Euclidean distance between two vectors (eq 3.1)."""
    total = 0.0
    for i in range(a.shape[0]):
        difference = a[i] - b[i]
        total += difference * difference
    return math.sqrt(total)


@njit(cache=True, nogil=True)
def comes_before(distance_a, key_a, distance_b, key_b):
    """Whether a is nearer than b; at equal distance, whether its sample number is smaller."""
    return distance_a < distance_b or (distance_a == distance_b and key_a < key_b)


@njit(cache=True, nogil=True)
def insert(distances, keys, values, count, new_distance, new_key, new_value):
    """Puts an entry into a list sorted by (distance, key) that keeps the first `distances.size`; returns its length."""
    capacity = distances.shape[0]
    if count == capacity:
        if not comes_before(new_distance, new_key, distances[count - 1], keys[count - 1]):
            return count
        place = count - 1
    else:
        place = count
        count += 1
    while place > 0 and comes_before(new_distance, new_key, distances[place - 1], keys[place - 1]):
        distances[place] = distances[place - 1]
        keys[place] = keys[place - 1]
        values[place] = values[place - 1]
        place -= 1
    distances[place] = new_distance
    keys[place] = new_key
    values[place] = new_value
    return count


# --- construction -----------------------------------------------------------------------------------------------


@njit(cache=True, nogil=True)
def nearest_child(points, sample, first_child, next_sibling, node, query):
    """The child of `node` that is nearest to sample `query`, and its distance. Ties go to the smaller sample number."""
    best = first_child[node]
    best_distance = distance(points[sample[best]], points[query])
    child = next_sibling[best]
    while child >= 0:
        here = distance(points[sample[child]], points[query])
        if comes_before(here, sample[child], best_distance, sample[best]):
            best = child
            best_distance = here
        child = next_sibling[child]
    return best, best_distance


@njit(cache=True, nogil=True)
def grow(points, radii):
    """Builds the tree level by level by the rules of Fig 3.18; radii[l - 1] is T(l).

    Returns (nodes, sample, parent, level, first_child, next_sibling, home): the number of nodes, arrays over nodes in
    the order in which they were made (node 0 is the virtual root, sample -1), and the leaf of every sample.

    The part of the tree above level l does not change while level l is made, so each sample's descent is remembered
    (`home`) and goes on from there instead of from the root; the outcome is the same.
    """
    n = points.shape[0]
    # Each sample enters once as a new vector, and each such entry splits at most one node, which then appears again.
    capacity = 2 * n + 1
    sample = np.full(capacity, -1, np.int64)
    parent = np.full(capacity, -1, np.int64)
    level = np.zeros(capacity, np.int64)
    first_child = np.full(capacity, -1, np.int64)
    last_child = np.full(capacity, -1, np.int64)
    next_sibling = np.full(capacity, -1, np.int64)
    home = np.zeros(n, np.int64)
    nodes = 1
    for current in range(1, radii.shape[0] + 1):
        radius = radii[current - 1]
        before = nodes
        for query in range(n):
            x = home[query]
            if level[x] < current - 1:
                continue
            if first_child[x] < 0:
                # A leaf on the level above. The virtual root is infinitely far from everything and has no vector
                # that could appear again below it.
                if x > 0 and not distance(points[sample[x]], points[query]) > radius:
                    continue
                newcomers = 1 if x == 0 else 2
            else:
                _, nearest = nearest_child(points, sample, first_child, next_sibling, x, query)
                if not nearest > radius:
                    continue
                newcomers = 1
            for i in range(newcomers):
                node = nodes
                nodes += 1
                sample[node] = sample[x] if newcomers - i == 2 else query
                parent[node] = x
                level[node] = current
                if first_child[x] < 0:
                    first_child[x] = node
                else:
                    next_sibling[last_child[x]] = node
                last_child[x] = node
        if nodes == before:
            # No leaf is on this level, so none can split on a later one.
            break
        for query in range(n):
            x = home[query]
            if level[x] == current - 1 and first_child[x] >= 0:
                home[query], _ = nearest_child(points, sample, first_child, next_sibling, x, query)
    return nodes, sample, parent, level, first_child, next_sibling, home


@njit(cache=True, nogil=True)
def arrange(nodes, first_child, next_sibling):
    """Breadth-first order of the nodes, in which children stand side by side in the order in which they were made.

    Returns (order, first, count): order[i] is the old number of new node i; first and count are the new number of the
    first child (0 for a leaf) and the number of children of each new node.
    """
    order = np.zeros(nodes, np.int64)
    first = np.zeros(nodes, np.int64)
    count = np.zeros(nodes, np.int64)
    end = 1
    for node in range(nodes):
        child = first_child[order[node]]
        if child >= 0:
            first[node] = end
        while child >= 0:
            order[end] = child
            end += 1
            count[node] += 1
            child = next_sibling[child]
    return order, first, count


@njit(cache=True, nogil=True)
def covering_radii(points, sample, parent, members, leaf_of_member):
    """For every node the distance from its vector to the farthest sample below it; infinite for the virtual root."""
    cover = np.zeros(sample.shape[0])
    cover[0] = np.inf
    for i in range(members.shape[0]):
        node = leaf_of_member[i]
        while node > 0:
            cover[node] = max(cover[node], distance(points[sample[node]], points[members[i]]))
            node = parent[node]
    return cover


# --- search -----------------------------------------------------------------------------------------------------


@njit(cache=True, nogil=True)
def scan_leaf(tree, leaf, query, ids, distances, count):
    """Offers the samples of `leaf` to the sorted list of the nearest; returns the list's length."""
    start = tree.first_member[leaf]
    for place in range(start, start + tree.member_count[leaf]):
        candidate = tree.members[place]
        here = distance(tree.points[candidate], query)
        # The identifier is both the key that breaks ties and the value.
        count = insert(distances, ids, ids, count, here, candidate, candidate)
    return count


@njit(cache=True, nogil=True)
def beam(tree, query, width, ids, distances):
    """Fills ids and distances with the nearest samples found by a beam search (3.2.2).

    On every level the `width` nearest nodes are kept and only their children looked at; a leaf, once reached, goes on
    competing with them. Returns how many samples were found.
    """
    nodes = np.zeros(width, np.int64)
    keys = np.zeros(width, np.int64)
    reach = np.zeros(width)
    next_nodes = np.zeros(width, np.int64)
    next_keys = np.zeros(width, np.int64)
    next_reach = np.zeros(width)
    held = 1  # the root
    descending = True
    while descending:
        descending = False
        next_held = 0
        for i in range(held):
            node = nodes[i]
            children = tree.child_count[node]
            if children == 0:
                next_held = insert(next_reach, next_keys, next_nodes, next_held, reach[i], keys[i], node)
                continue
            descending = True
            for child in range(tree.first_child[node], tree.first_child[node] + children):
                key = tree.sample[child]
                here = distance(tree.points[key], query)
                next_held = insert(next_reach, next_keys, next_nodes, next_held, here, key, child)
        nodes, next_nodes = next_nodes, nodes
        keys, next_keys = next_keys, keys
        reach, next_reach = next_reach, reach
        held = next_held
    count = 0
    for i in range(held):
        count = scan_leaf(tree, nodes[i], query, ids, distances, count)
    return count


@njit(cache=True, nogil=True)
def exact(tree, query, ids, distances):
    """Fills ids and distances with the true nearest samples: depth first, nearest child first, branch and bound.

    A subtree is left out when even the nearest point of its covering ball is farther than the worst neighbour held.
    Returns how many samples were found.
    """
    k = ids.shape[0]
    waiting = np.zeros(tree.waiting, np.int64)
    centre = np.zeros(tree.waiting)
    bound = np.zeros(tree.waiting)
    top = 1  # the root
    count = 0
    while top > 0:
        top -= 1
        node = waiting[top]
        if count == k and bound[top] > distances[k - 1]:
            continue
        if tree.child_count[node] == 0:
            count = scan_leaf(tree, node, query, ids, distances, count)
            continue
        base = top
        for child in range(tree.first_child[node], tree.first_child[node] + tree.child_count[node]):
            here = distance(tree.points[tree.sample[child]], query)
            lower = here - tree.cover[child] - SLACK * (here + tree.cover[child])
            if count == k and lower > distances[k - 1]:
                continue
            # Farthest first, so that the nearest is popped first.
            place = top
            while place > base and centre[place - 1] < here:
                waiting[place] = waiting[place - 1]
                centre[place] = centre[place - 1]
                bound[place] = bound[place - 1]
                place -= 1
            waiting[place] = child
            centre[place] = here
            bound[place] = lower
            top += 1
    return count


@njit(cache=True, nogil=True)
def beam_many(tree, queries, width, ids, distances):
    """`beam` for every row of queries."""
    for i in range(queries.shape[0]):
        beam(tree, queries[i], width, ids[i], distances[i])


@njit(cache=True, nogil=True)
def exact_many(tree, queries, ids, distances):
    """`exact` for every row of queries."""
    for i in range(queries.shape[0]):
        exact(tree, queries[i], ids[i], distances[i])


# --- local fits -------------------------------------------------------------------------------------------------


@njit(cache=True, nogil=True)
def solve_in_place(matrix, right):
    """Solves matrix @ x = right by Cholesky's factors; matrix is symmetric and positive definite; x replaces right."""
    n = matrix.shape[0]
    for j in range(n):
        for i in range(j, n):
            total = matrix[i, j]
            for s in range(j):
                total -= matrix[i, s] * matrix[j, s]
            matrix[i, j] = math.sqrt(total) if i == j else total / matrix[j, j]
    for column in range(right.shape[1]):
        for i in range(n):
            total = right[i, column]
            for s in range(i):
                total -= matrix[i, s] * right[s, column]
            right[i, column] = total / matrix[i, i]
        for i in range(n - 1, -1, -1):
            total = right[i, column]
            for s in range(i + 1, n):
                total -= matrix[s, i] * right[s, column]
            right[i, column] = total / matrix[i, i]


@njit(cache=True, nogil=True)
def terms(offset, degree, out):
    """Fills out with the terms of a polynomial in offset (d,): its components; for degree 2 also all their products.

    Mixed products carry a factor sqrt(2): then a ridge on the products does not depend on how the inputs are rotated.
    """
    d = offset.shape[0]
    out[:d] = offset
    if degree == 2:
        place = d
        for a in range(d):
            for b in range(a, d):
                out[place] = offset[a] * offset[b] * (1.0 if a == b else SQRT2)
                place += 1


@njit(cache=True, nogil=True)
def local_fit(query, inputs, outputs, weights, degree, ridge, curvature_ridge, value, slope):
    """Fits a polynomial of degree 1 or 2 to k neighbours by weighted, ridge-regularised least squares.

    inputs (k, d); outputs (k, p); weights (k,) not negative and not all zero. Inputs are counted from their weighted
    mean in units of their spread, so the ridges (> 0) are shares of the inputs' variance. The constant term is free.
    Fills value (p,), the polynomial at the query, and slope (p, d), its gradient at the neighbours' mean.
    """
    k, d = inputs.shape
    p = outputs.shape[1]
    count = d if degree == 1 else d + d * (d + 1) // 2
    total = 0.0
    for i in range(k):
        total += weights[i]
    middle = np.zeros(d)
    value[:] = 0.0
    for i in range(k):
        share = weights[i] / total
        middle += share * inputs[i]
        value += share * outputs[i]
    slope[:] = 0.0
    variance = 0.0
    for i in range(k):
        variance += weights[i] / total * distance(inputs[i], middle) ** 2 / d
    if variance == 0.0:
        # All neighbours lie on one point and say nothing about slopes.
        return
    spread = math.sqrt(variance)
    design = np.zeros((k, count))
    mean = np.zeros(count)
    for i in range(k):
        terms((inputs[i] - middle) / spread, degree, design[i])
        mean += weights[i] / total * design[i]
    moments = np.zeros((count, count))
    coefficients = np.zeros((count, p))
    for i in range(k):
        share = weights[i] / total
        for a in range(count):
            off = share * (design[i, a] - mean[a])
            for b in range(a + 1):
                moments[a, b] += off * (design[i, b] - mean[b])
            for b in range(p):
                coefficients[a, b] += off * (outputs[i, b] - value[b])
    for a in range(count):
        moments[a, a] += ridge if a < d else curvature_ridge
    solve_in_place(moments, coefficients)
    here = np.zeros(count)
    terms((query - middle) / spread, degree, here)
    for b in range(p):
        for a in range(count):
            value[b] += (here[a] - mean[a]) * coefficients[a, b]
        for a in range(d):
            slope[b, a] = coefficients[a, b] / spread
