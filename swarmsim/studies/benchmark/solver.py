"""The solvers of OR-tools: routes of several vehicles, and large linear programmes."""

from __future__ import annotations

import importlib
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from swarmsim.core.errors import InputError

ITERATIONS: Final = 2000  # of the solver of linear programmes
NEAR: Final = 3e-4  # of the optimum
NEVER: Final = 3600  # s, since without a limit of time it warns; looks come first


def shorter(matrix: NDArray[np.int64], routes: list[list[int]], span: int, looks: int) -> list[list[int]]:
    """Cheaper routes through the same nodes, by guided local search (Voudouris and Tsang 1999).

    `matrix` holds the costs between nodes: the starts of the routes, in order, then stops, then the common end. The
    cost is that of all arcs, plus `span` times that of the dearest route. The search looks so often at what it has:
    looks are counted, not seconds, so that the same routes come out on any machine. Raises InputError without OR-tools.
    """
    pywrapcp, enums = _of("constraint_solver.pywrapcp"), _of("constraint_solver.routing_enums_pb2")
    count, end = len(routes), len(matrix) - 1
    manager = pywrapcp.RoutingIndexManager(len(matrix), count, list(range(count)), [end] * count)
    model = pywrapcp.RoutingModel(manager)
    transit = model.RegisterTransitMatrix(matrix.tolist())
    model.SetArcCostEvaluatorOfAllVehicles(transit)
    model.AddDimension(transit, 0, int(matrix.max(axis=1).sum()), True, "way")
    model.GetDimensionOrDie("way").SetGlobalSpanCostCoefficient(span)
    asked = pywrapcp.DefaultRoutingSearchParameters()
    asked.local_search_metaheuristic = enums.LocalSearchMetaheuristic.GUIDED_LOCAL_SEARCH
    asked.time_limit.FromSeconds(NEVER)
    model.CloseModelWithParameters(asked)
    left = iter(range(looks))
    model.AddSearchMonitor(model.solver().CustomLimit(lambda: next(left, None) is None))
    # Not from its own first routes: with a span cost these give two vehicles everything.
    given = model.ReadAssignmentFromRoutes(routes, True)
    found = model.SolveFromAssignmentWithParameters(given, asked) or given
    better = []
    for robot in range(count):
        node, way = found.Value(model.NextVar(model.Start(robot))), list[int]()
        while not model.IsEnd(node):
            way.append(manager.IndexToNode(node))
            node = found.Value(model.NextVar(node))
        better.append(way)
    return better


def worthiest(worth: NDArray[np.float64], matrix: sparse.csc_array, limits: NDArray[np.float64]) -> NDArray[np.float64]:
    """About the values (m,), 0 or more, that are worth most while `matrix` times them is about at most `limits`.

    By the primal-dual hybrid gradient (PDLP: Applegate et al. 2021). Raises InputError without OR-tools.
    """
    pdlp, parameters = _of("pdlp.python.pdlp"), _of("pdlp.solvers_pb2")
    programme = pdlp.QuadraticProgram()
    programme.objective_vector = -worth
    programme.constraint_matrix = sparse.csc_matrix(matrix)
    programme.constraint_lower_bounds = np.full(len(limits), -np.inf)
    programme.constraint_upper_bounds = limits
    programme.variable_lower_bounds = np.zeros(len(worth))
    programme.variable_upper_bounds = np.full(len(worth), np.inf)
    asked = parameters.PrimalDualHybridGradientParams()
    asked.termination_criteria.iteration_limit = ITERATIONS
    asked.termination_criteria.simple_optimality_criteria.eps_optimal_relative = NEAR
    asked.termination_criteria.simple_optimality_criteria.eps_optimal_absolute = NEAR
    return np.asarray(pdlp.primal_dual_hybrid_gradient(programme, asked).primal_solution)


def _of(module: str) -> Any:  # noqa: ANN401 - a module without types
    """A module of OR-tools. Raises InputError without it."""
    try:
        return importlib.import_module(f"ortools.{module}")
    except ImportError as problem:
        raise InputError(
            "a tour with the map known needs ortools; install it with: pip install 'swarmsim-lab[benchmark]'"
        ) from problem
