"""Gaussian elimination on a graph: which row has the fewest neighbours, and what it leaves behind.

A quotient graph keeps eliminated rows as elements, the cliques that they leave. Row i has a list of
elements, followed by a list of its neighbours outside these elements. Together with the rows of
each element, these lists never take more room than the original graph.
"""

from __future__ import annotations

import numpy as np

from . import compiled, inlined

#: after so many looks per entry of A the rest of the graph is cut in the middle, and so again whenever they have
#: doubled; looking is given up where it takes so many times what it cost so far to factorise what the cut leaves, which
#: is up to 9 times too much on graphs without geometry
_BACK = 3
_PATIENCE = 300.0


@inlined
def _insert(i, degree, head, after, before):
    d = degree[i]
    j = head[d]
    after[i] = j
    before[i] = -1
    head[d] = i
    if j >= 0:
        before[j] = i


@inlined
def _remove(i, degree, head, after, before):
    if before[i] >= 0:
        after[before[i]] = after[i]
    else:
        head[degree[i]] = after[i]
    if after[i] >= 0:
        before[after[i]] = before[i]


@compiled
def _packed(start, length, weight, mark, lists):
    # what is alive, moved together into new lists; returns them and where they end
    # (loops, as a slice that is assigned to takes three seconds to compile)
    packed = np.empty_like(lists)
    end = 0
    for i in range(start.size):
        if weight[i] != 0 and length[i] > 0 and mark[i] != 0:
            for k in range(length[i]):
                packed[end + k] = lists[start[i] + k]
            start[i] = end
            end += length[i]
    return packed, end


@compiled
def _element(me, lists, end, start, length, elements, weight, degree, mark, head, after, before):
    # the rows that hang together once `me` is eliminated, written to `end` and flagged by a negative weight; the
    # elements of `me` are part of the new one. Returns where the lists end then, the sum of the weights, and the looks.
    total = 0
    looks = 0
    first = start[me]
    for k in range(elements[me] + 1):
        last = k == elements[me]
        e = me if last else lists[first + k]
        low, high = (first + k, first + length[me]) if last else (start[e], start[e] + length[e])
        looks += high - low
        for at in range(low, high):
            i = lists[at]
            if weight[i] > 0:
                total += weight[i]
                weight[i] = -weight[i]
                lists[end] = i
                end += 1
                _remove(i, degree, head, after, before)
        if not last:
            mark[e] = 0
            length[e] = 0
    return end, total, looks


@compiled
def _outside(rows, lists, start, elements, weight, degree, mark, flag):
    # mark_e - flag = the weight of the part of each element e that is outside the new one, whose `rows` these are
    looks = 0
    for i in rows:
        looks += elements[i]
        for k in range(start[i], start[i] + elements[i]):
            e = lists[k]
            if mark[e] >= flag:
                mark[e] += weight[i]
            elif mark[e] != 0:
                mark[e] = degree[e] + flag + weight[i]
    return looks


@compiled
def _cleaned(i, me, lists, start, length, elements, weight, mark, flag):
    # the lists of row i without what the new element `me` covers, `me` first; returns the weight of what is left
    # outside and a number that rows with equal lists have in common
    low = start[i]
    at = low
    outside = 0
    key = 0
    for k in range(low, low + elements[i]):
        e = lists[k]
        if mark[e] != 0:
            if mark[e] > flag:
                outside += mark[e] - flag
                key += e
                lists[at] = e
                at += 1
            else:
                mark[e] = 0  # all of it is inside the new element
    middle = at
    for k in range(low + elements[i], low + length[i]):
        j = lists[k]
        if weight[j] > 0:
            outside += weight[j]
            key += j
            lists[at] = j
            at += 1
    # the place of what led to i, an element that is gone or `me` itself, is free
    lists[at], lists[middle], lists[low] = lists[middle], lists[low], me
    elements[i] = middle - low + 1
    length[i] = at - low + 1
    return outside, key


@compiled
def _merged(rows, lists, start, length, elements, weight, mark, flag, bucket, chain, keys, into):
    # rows with equal lists become one; returns the next flag
    for row in rows:
        if weight[row] == 0:
            continue
        i = bucket[keys[row]]
        bucket[keys[row]] = -1
        while i >= 0 and chain[i] >= 0:
            for k in range(start[i] + 1, start[i] + length[i]):
                mark[lists[k]] = flag
            before = i
            j = chain[i]
            while j >= 0:
                same = length[j] == length[i] and elements[j] == elements[i]
                k = start[j] + 1
                while same and k < start[j] + length[j]:
                    same = mark[lists[k]] == flag
                    k += 1
                if same:
                    weight[i] += weight[j]
                    weight[j] = 0
                    into[j] = i
                    chain[before] = chain[j]
                else:
                    before = j
                j = chain[j]
            flag += 1
            i = chain[i]
    return flag


@compiled
def _begun(start, length):
    # what is known of each row: where its lists start, their length, how many elements are in them (-1 for an element),
    # weight (how many rows it stands for), degree, mark, the next and the one before it in the queue of its degree, the
    # head of the queue and the bucket that have its number, its key, and the row that it goes with
    # (loops, as slices that are assigned to take a second to compile)
    n = length.size
    state = np.empty((12, n), np.int64)
    for i in range(n):
        for k in range(6, 12):
            state[k, i] = -1
        state[0, i] = start[i]
        state[1, i] = length[i]
        state[2, i] = 0
        state[3, i] = 1
        state[4, i] = length[i]
        state[5, i] = 1
    for i in range(n):
        if length[i] < 0:
            state[3, i] = 0
        else:
            _insert(i, state[4], state[8], state[6], state[7])
    return state


@compiled
def _eliminated(me, end, flag, widest, left, lists, state):
    # row `me` becomes an element; returns where the lists end, how many rows went with it, the weight of the element,
    # the next flag and the looks
    start, length, elements, weight, degree, mark = state[0], state[1], state[2], state[3], state[4], state[5]
    after, before, head, bucket, keys, into = state[6], state[7], state[8], state[9], state[10], state[11]
    low = end
    pivots = weight[me]
    weight[me] = -pivots
    end, size, looks = _element(me, lists, low, start, length, elements, weight, degree, mark, head, after, before)
    rows = lists[low:end]
    looks += _outside(rows, lists, start, elements, weight, degree, mark, flag)
    for i in rows:
        looks += length[i]
        outside, key = _cleaned(i, me, lists, start, length, elements, weight, mark, flag)
        if outside == 0:  # it can go together with `me`
            pivots -= weight[i]
            size += weight[i]
            weight[i] = 0
            into[i] = me
        else:
            degree[i] = min(degree[i], outside)
            keys[i] = key % length.size
            after[i] = bucket[keys[i]]
            bucket[keys[i]] = i
    flag += max(widest, size)
    flag = _merged(rows, lists, start, length, elements, weight, mark, flag, bucket, after, keys, into)
    end = low
    for i in rows:
        if weight[i] != 0:
            weight[i] = -weight[i]
            degree[i] = min(degree[i] + size, left - pivots) - weight[i]
            _insert(i, degree, head, after, before)
            lists[end] = i
            end += 1
    start[me] = low
    length[me] = end - low
    elements[me] = -1
    weight[me] = pivots
    degree[me] = size
    if low == end:
        mark[me] = 0
    return end, pivots, size, flag, looks


@compiled
def _layered(first, level, queue, done, lists, start, length, elements, weight):
    # breadth-first layers from row `first` over the rows whose level is -1 yet, an element being passed through once;
    # returns the weight of the heaviest layer and the last row
    queue[0] = first
    level[first] = 0
    at = 0
    end = 1
    depth = 0
    layer = 0
    heaviest = 0
    while at < end:
        i = queue[at]
        if level[i] > depth:
            depth = level[i]
            layer = 0
        layer += weight[i]
        heaviest = max(heaviest, layer)
        for k in range(start[i], start[i] + length[i]):
            e = lists[k]
            element = k < start[i] + elements[i]
            if element and done[e]:
                continue
            done[e] = element
            low, high = (start[e], start[e] + length[e]) if element else (k, k + 1)
            for m in range(low, high):
                j = lists[m]
                if weight[j] > 0 and level[j] < 0:
                    level[j] = depth + 1
                    queue[end] = j
                    end += 1
        at += 1
    return heaviest, queue[end - 1]


@compiled
def _separator(lists, start, length, elements, weight):
    # the weight of the heaviest layer, seen from the far end of the part of the graph where it is heaviest: about what
    # has to be eliminated at last, together, where no small separator cuts the rest of the graph
    n = start.size
    level = np.full(n, -1, np.int32)
    queue = np.empty(n, np.int32)
    done = np.zeros(n, np.bool_)
    heaviest = 0
    last = np.int64(-1)
    for i in range(n):
        if elements[i] >= 0 and weight[i] > 0 and level[i] < 0:
            layer, end = _layered(i, level, queue, done, lists, start, length, elements, weight)
            if layer > heaviest:
                heaviest = layer
                last = end
    for i in range(n):
        level[i] = -1
        done[i] = False
    return _layered(last, level, queue, done, lists, start, length, elements, weight)[0] if last >= 0 else 0


@inlined
def _dense(rows):
    # the entries of L and their squares, column by column, of a dense matrix
    rest = float(rows)
    return 0.5 * rest * (rest - 1.0), (rest - 1.0) * rest * (2.0 * rest - 1.0) / 6.0


@compiled
def minimum_degree(start, length, lists, end, left_out, stored, prices, most_entries, most_cost, most_looks):
    # rows of the least approximate degree first. Returns the entries of L without its diagonal, the sum of their
    # squares column by column, what was looked at, whether it came to the end within the limits, and for each row the
    # one that it goes with, and when that was eliminated. It ends early where the entries, or what the factorisation
    # costs by the `prices` of (an entry, a multiplication, a look), are more than the limits, and where a separator of
    # the rest tells that it costs more than that, or some hundred times what it did to look, or after so many looks:
    # then entries and squares are rough
    an_entry, a_flop, a_look = prices
    average = length.sum() / length.size
    turn = np.full(length.size, length.size)
    step = 0
    state = _begun(start, length)
    start, length, elements, weight, degree, mark = state[0], state[1], state[2], state[3], state[4], state[5]
    after, before, head = state[6], state[7], state[8]
    left = length.size - left_out
    # of a literal number a function that is called makes a second version
    flag = np.int64(2)
    widest = np.int64(0)
    least = looks = 0
    entries = squares = 0.0
    back = _BACK * stored
    while left:
        while head[least] < 0:
            least += 1
        if 2 * least > left:  # as good as dense
            break
        me = head[least]
        turn[me] = step
        step += 1
        room = length[me]
        _remove(me, degree, head, after, before)
        for k in range(start[me], start[me] + elements[me]):
            room += length[lists[k]]
        if end + room > lists.size:
            lists, end = _packed(start, length, weight, mark, lists)
        end, pivots, size, flag, more = _eliminated(me, end, flag, widest, left, lists, state)
        left -= pivots
        looks += more
        widest = max(widest, size)
        for k in range(start[me], end):
            least = min(least, degree[lists[k]])
        # columns of size + left_out, and up to so many pivots more, entries
        first = _dense(size + left_out)
        last = _dense(size + left_out + pivots)
        entries += last[0] - first[0]
        squares += last[1] - first[1]
        if looks > most_looks or entries > most_entries or an_entry * entries + a_flop * squares > most_cost:
            return entries, squares, looks, False, state[11], turn
        # pivots with fewer neighbours than there were on the average hardly fill it up, whatever hangs together
        if looks > back and least >= average:
            further = _dense(_separator(lists, start, length, elements, weight))
            back = 2 * looks
            if an_entry * further[0] + a_flop * further[1] > min(most_cost, _PATIENCE * a_look * looks):
                return entries + further[0], squares + further[1], looks, False, state[11], turn
    rest = _dense(left + left_out)
    entries += rest[0]
    squares += rest[1]
    within = entries <= most_entries and an_entry * entries + a_flop * squares <= most_cost
    return entries, squares, looks, within, state[11], turn
